; Sleeps between the overflows of Timer1, which come every 800 cycles; D9 rises with each.
#include "common.inc"

    vector 0, start
    vector 13, on_overflow

    .org 26 * 4
start:
    ldi  r16, lo8(RAMEND)
    out  SPL, r16
    ldi  r16, hi8(RAMEND)
    out  SPH, r16
    ldi  r16, (1 << 1)
    out  DDRB, r16
    ldi  r16, hi8(799)
    sts  ICR1H, r16
    ldi  r16, lo8(799)
    sts  ICR1L, r16
    ldi  r16, (2 << COM1A0) | (1 << WGM11)
    sts  TCCR1A, r16
    ldi  r16, (1 << WGM13) | (1 << WGM12) | (1 << CS10)
    sts  TCCR1B, r16
    ldi  r16, (1 << TOIE1)
    sts  TIMSK1, r16
    ldi  r16, (1 << SE)
    out  SMCR, r16
    sei
wait:
    sleep
    rjmp wait

on_overflow:
    out  GPIOR0, r16
    nop
    nop
    sbi  GPIOR0, 7
    reti
