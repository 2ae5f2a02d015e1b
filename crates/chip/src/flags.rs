//! Interrupt flags of the timers and of INT0/INT1.
//!
//! * A flag raised while its interrupt is disabled fires as soon as it is enabled (section 7.7: "interrupt conditions …
//!   will be remembered until the corresponding interrupt enable bit is set"). simavr never fires it.
//! * EIFR is cleared by writing ones (section 13.2.3). simavr stores the ones.
//! * SBI on a flag register writes that one bit (section 36, note 3: SBI and CBI "will only operate on the specified
//!   bit"). simavr reads, modifies and writes, which clears all flags of the register.

use super::ffi::Cpu;
use super::registers::*;

/// A flag register, the enable register of the same bits, and the vectors of the bits used.
struct Group {
    flags: u16,
    enables: u16,
    vectors: &'static [(u8, u8)],
}

const GROUPS: [Group; 4] = [
    Group {
        flags: TIFR0,
        enables: TIMSK0,
        vectors: &[(0, vector::TIMER0_OVF), (1, vector::TIMER0_COMPA), (2, vector::TIMER0_COMPB)],
    },
    Group {
        flags: TIFR1,
        enables: TIMSK1,
        vectors: &[
            (0, vector::TIMER1_OVF),
            (1, vector::TIMER1_COMPA),
            (2, vector::TIMER1_COMPB),
            (5, vector::TIMER1_CAPT),
        ],
    },
    Group {
        flags: TIFR2,
        enables: TIMSK2,
        vectors: &[(0, vector::TIMER2_OVF), (1, vector::TIMER2_COMPA), (2, vector::TIMER2_COMPB)],
    },
    Group { flags: EIFR, enables: EIMSK, vectors: &[(0, vector::INT0), (1, vector::INT1)] },
];

/// Stores a write to an enable register and requests what waited for it; `false` if the address is not one of them.
pub(super) fn enable(cpu: &Cpu, address: u16, value: u8) -> bool {
    let Some(group) = GROUPS.iter().find(|g| g.enables == address) else { return false };
    let newly = value & !cpu.read(address);
    cpu.write(address, value);
    if address == TIMSK2 {
        timer2_compares(cpu, value);
    }
    for &(bit, vector) in group.vectors {
        if newly & cpu.read(group.flags) & (1 << bit) != 0 {
            cpu.raise(vector);
        }
    }
    true
}

/// Lets the compare units of Timer2 work whose interrupts are enabled. As a free-running time stamp at the processor's
/// clock its compare matches would take a tenth of the simulator's work. Nobody looks at their flags: OCF2A and OCF2B
/// are not raised while their interrupts are disabled.
pub(super) fn timer2_compares(cpu: &Cpu, enables: u8) {
    for (unit, register) in [OCR2A, OCR2B].into_iter().enumerate() {
        cpu.set_timer2_compare(unit, enables & (2 << unit) != 0);
        let value = cpu.read(register);
        cpu.write_through(register, value);
    }
}

/// Clears one flag. Returns its vector, or `None` if the register has no such flag.
pub(super) fn clear_bit(cpu: &Cpu, address: u16, bit: u8) -> Option<u8> {
    let group = GROUPS.iter().find(|g| g.flags == address)?;
    let (_, vector) = *group.vectors.iter().find(|(b, _)| *b == bit)?;
    cpu.clear(vector);
    Some(vector)
}

/// Forgets the flags of pins whose interrupt is set to the low level. The chip has none for them (section 13.2.3), but
/// simavr sets them with each change of the pin.
pub(super) fn forget_levels(cpu: &Cpu) {
    let sense = cpu.read(EICRA);
    for (bit, mask) in [(0, 0b0011), (1, 0b1100)] {
        let enabled = cpu.read(EIMSK) & (1 << bit) != 0;
        if sense & mask == 0 && !enabled && cpu.read(EIFR) & (1 << bit) != 0 {
            clear_bit(cpu, EIFR, bit);
        }
    }
}
