; Runs into the erased flash's neighbour: a word that is no instruction.
#include "common.inc"

    vector 0, start
    .org 26 * 4
start:
    nop
    .word 0x940B
    rjmp start
