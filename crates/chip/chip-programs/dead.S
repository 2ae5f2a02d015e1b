; Goes to sleep for ever.
#include "common.inc"

    vector 0, start
    .org 26 * 4
start:
    cli
    ldi  r16, (1 << SE)
    out  SMCR, r16
    sleep
    rjmp start
