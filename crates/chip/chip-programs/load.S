; A load like the firmware's, for measuring the simulator's own speed: 20 kHz PWM, a conversion every second period,
; a tick of 400 cycles every millisecond, both lines of the encoder with time stamps, a byte to the host whenever
; possible, and a main loop that never sleeps.
#include "common.inc"

    vector 0, start
    vector 1, on_edge
    vector 2, on_edge
    vector 14, on_tick
    vector 19, on_empty
    vector 21, on_converted

    .org 26 * 4
start:
    ldi  r16, lo8(RAMEND)
    out  SPL, r16
    ldi  r16, hi8(RAMEND)
    out  SPH, r16
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
    ldi  r16, hi8(640)
    sts  OCR1BH, r16
    ldi  r16, lo8(640)
    sts  OCR1BL, r16
    ldi  r16, (2 << COM1A0) | (1 << WGM11)
    sts  TCCR1A, r16
    ldi  r16, (1 << WGM13) | (1 << WGM12) | (1 << CS10)
    sts  TCCR1B, r16
    sbi  PORTD, 7
    ldi  r16, (1 << REFS0)
    sts  ADMUX, r16
    ldi  r16, 5
    sts  ADCSRB, r16
    ldi  r16, (1 << ADEN) | (1 << ADATE) | (1 << ADIE) | 6
    sts  ADCSRA, r16
    ldi  r16, (1 << U2X0)
    sts  UCSR0A, r16
    ldi  r16, 3
    sts  UBRR0L, r16
    ldi  r16, (1 << TXEN0) | (1 << UDRIE0)
    sts  UCSR0B, r16
    ldi  r16, 3
    out  TCCR0B, r16
    ldi  r16, 1
    sts  TCCR2B, r16
    ldi  r16, 250
    out  OCR0A, r16
    ldi  r16, (1 << OCIE0A)
    sts  TIMSK0, r16
    ldi  r16, 0b0101
    sts  EICRA, r16
    ldi  r16, 0b11
    out  EIFR, r16
    out  EIMSK, r16
    sei
wait:
    adiw r24, 1
    lds  r20, 0x100
    add  r20, r24
    sts  0x100, r20
    rjmp wait

on_edge:
    push r24
    in   r24, SREG
    push r24
    in   r24, PIND
    in   r24, TCNT0
    out  GPIOR1, r24
    lds  r24, TCNT2
    out  GPIOR2, r24
    pop  r24
    out  SREG, r24
    pop  r24
    reti

on_tick:
    push r24
    in   r24, SREG
    push r24
    in   r24, OCR0A
    subi r24, 6
    out  OCR0A, r24
    sei
    ldi  r24, 130
1:  dec  r24
    brne 1b
    lds  r24, OCR1AL
    inc  r24
    sts  OCR1AL, r24
    pop  r24
    out  SREG, r24
    pop  r24
    reti

on_empty:
    push r24
    ldi  r24, 'x'
    sts  UDR0, r24
    pop  r24
    reti

on_converted:
    push r24
    ldi  r24, (1 << OCF1B)
    out  TIFR1, r24
    lds  r24, ADCL
    lds  r24, ADCH
    pop  r24
    reti
