; Drives the motor as the firmware does: Timer1 in mode 14 with 800 steps, braking wiring, half duty forward. Counts the
; edges of the encoder in a table-free way: one 16-bit counter per line.
#include "common.inc"

    vector 0, start
    vector 1, on_a
    vector 2, on_b

    .org 26 * 4
start:
    ldi  r16, lo8(RAMEND)
    out  SPL, r16
    ldi  r16, hi8(RAMEND)
    out  SPH, r16
    clr  r24
    clr  r25
    clr  r26
    clr  r27
    ldi  r16, (1 << 7)
    out  DDRD, r16
    ldi  r16, (1 << 0) | (1 << 1)
    out  DDRB, r16
    ldi  r16, hi8(799)
    sts  ICR1H, r16
    ldi  r16, lo8(799)
    sts  ICR1L, r16
    ldi  r16, hi8(399)
    sts  OCR1AH, r16
    ldi  r16, lo8(399)
    sts  OCR1AL, r16
    ldi  r16, (2 << COM1A0) | (1 << WGM11)
    sts  TCCR1A, r16
    ldi  r16, (1 << WGM13) | (1 << WGM12) | (1 << CS10)
    sts  TCCR1B, r16
    sbi  PORTD, 7
    ldi  r16, 0b0101
    sts  EICRA, r16
    ldi  r16, 0b11
    out  EIFR, r16
    out  EIMSK, r16
    ldi  r16, (1 << SE)
    out  SMCR, r16
    sei
wait:
    sleep
    rjmp wait

on_a:
    in   r0, SREG
    adiw r24, 1
    out  SREG, r0
    reti

on_b:
    in   r0, SREG
    adiw r26, 1
    out  SREG, r0
    reti
