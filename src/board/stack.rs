//! What the stack has never used: painted at the start, looked at by the tick and by `status`.

use core::ptr::addr_of;

unsafe extern "C" {
    /// Where the variables end; the linker says it.
    static _end: u8;
}

/// What is not used still holds this.
const PAINT: u8 = 0xc5;
/// The stack pointer in the address space of the data.
const STACK_POINTER: *const u16 = 0x5d as *const u16;

/// Paints all between the variables and the stack as it is; interrupts must be off.
#[inline(always)]
pub fn paint() {
    // SAFETY: the register is there.
    let top = unsafe { STACK_POINTER.read_volatile() };
    let mut at = addr_of!(_end).cast_mut();
    while (at as u16) < top {
        // SAFETY: nobody uses what lies between the variables and the stack.
        unsafe { at.write_volatile(PAINT) };
        at = at.wrapping_add(1);
    }
}

/// Whether the stack has come to the variables.
#[inline(always)]
pub fn overflown() -> bool {
    // SAFETY: the first byte behind the variables.
    unsafe { addr_of!(_end).read_volatile() != PAINT }
}

/// Bytes that were never used.
pub fn never_used() -> u16 {
    let mut count = 0;
    // SAFETY: within the memory: the stack itself holds other bytes.
    while unsafe { addr_of!(_end).wrapping_add(count as usize).read_volatile() } == PAINT {
        count += 1;
    }
    count
}
