; Does to the registers of the chip what the test tells it, with real instructions: the test puts a list of
; (address, value) into the SRAM and then its length; entries are executed in order. Every interrupt is counted.
#include "common.inc"

#define LENGTH   0x0100 /* entries to execute, 0 when done */
#define ENTRIES  0x0104 /* address low, address high (bit 7: read), value */
#define COUNTS   0x0300 /* one byte per vector */
#define RESULT   0x0320 /* last result of the converter */
#define RECEIVED 0x0340 /* bytes received, up to 32 */

.macro count number
    push r16
    in   r16, SREG
    push r16
    lds  r16, COUNTS + \number
    inc  r16
    sts  COUNTS + \number, r16
.endm

.macro leave
    pop  r16
    out  SREG, r16
    pop  r16
    reti
.endm

    vector 0, start
    .irp number, 1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17
    vector \number, on_\number
    .endr
    vector 18, on_received
    vector 19, on_empty
    vector 20, on_20
    vector 21, on_converted
    vector 22, on_eeprom
    vector 23, on_23
    vector 24, on_24
    vector 25, on_25

    .org 26 * 4
start:
    ldi  r16, lo8(RAMEND)
    out  SPL, r16
    ldi  r16, hi8(RAMEND)
    out  SPH, r16
    ldi  r16, 0
    ldi  r30, lo8(COUNTS)
    ldi  r31, hi8(COUNTS)
clear:
    st   Z+, r16
    cpi  r30, 0x80
    brne clear
    sts  LENGTH, r16
    sei
idle:
    lds  r18, LENGTH
    tst  r18
    breq idle
    ldi  r30, lo8(ENTRIES)
    ldi  r31, hi8(ENTRIES)
next:
    ld   r26, Z+
    ld   r27, Z+
    ld   r17, Z
    sbrc r27, 7
    rjmp fetch
    sbrc r27, 6
    rjmp program
    st   X, r17
    rjmp done
fetch:
    andi r27, 0x7F
    ld   r17, X
    rjmp done
program:
    out  EEARL, r26
    out  EEDR, r17
    sbi  EECR, EEMPE
    sbi  EECR, EEPE
done:
    st   Z+, r17
    dec  r18
    brne next
    sts  LENGTH, r18
    rjmp idle

    .irp number, 1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,20,23,24,25
on_\number:
    count \number
    leave
    .endr

on_received:
    count 18
    push r30
    push r31
    ldi  r31, hi8(RECEIVED)
    lds  r30, COUNTS + 18
    subi r30, 1 - (RECEIVED & 0xFF)
    lds  r16, UDR0
    st   Z, r16
    pop  r31
    pop  r30
    leave

on_empty:
    count 19
    lds  r16, UCSR0B
    andi r16, ~(1 << UDRIE0) & 0xFF
    sts  UCSR0B, r16
    leave

on_converted:
    count 21
    lds  r16, ADCL
    sts  RESULT, r16
    lds  r16, ADCH
    sts  RESULT + 1, r16
    sbi  TIFR1, OCF1B
    leave

on_eeprom:
    count 22
    cbi  EECR, EERIE
    leave
