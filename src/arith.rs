//! The multiplications of the control path.
//!
//! The ATmega328P multiplies 8 by 8 bits in two cycles. The compiler turns `i16 as i32 * i16 as i32` into a call of the
//! general 32-bit product (81 cycles); composed of four 8-bit products it takes 20. Every function here is exact and
//! cannot overflow; on the host it is the plain product, and a test on the simulated chip compares the two.

#[cfg(target_arch = "avr")]
use core::arch::asm;

/// Exact product of two signed 16-bit numbers.
#[inline(always)]
pub fn mul_i16(a: i16, b: i16) -> i32 {
    #[cfg(target_arch = "avr")]
    {
        let (low, high): (u16, u16);
        // SAFETY: pure register arithmetic; r1, which the compiler holds at zero, is zero again at the end.
        unsafe {
            asm!(
                "clr r26",
                "muls r19, r21",
                "movw r24, r0",
                "mul r18, r20",
                "movw r22, r0",
                "mulsu r19, r20",
                "sbc r25, r26",
                "add r23, r0",
                "adc r24, r1",
                "adc r25, r26",
                "mulsu r21, r18",
                "sbc r25, r26",
                "add r23, r0",
                "adc r24, r1",
                "adc r25, r26",
                "clr r1",
                in("r19r18") a,
                in("r21r20") b,
                out("r23r22") low,
                out("r25r24") high,
                out("r26") _,
                options(pure, nomem, nostack)
            );
        }
        ((high as u32) << 16 | low as u32) as i32
    }
    #[cfg(not(target_arch = "avr"))]
    {
        a as i32 * b as i32
    }
}

/// Exact product of two unsigned 16-bit numbers.
#[inline(always)]
pub fn mul_u16(a: u16, b: u16) -> u32 {
    #[cfg(target_arch = "avr")]
    {
        let (low, high): (u16, u16);
        // SAFETY: pure register arithmetic; r1, which the compiler holds at zero, is zero again at the end.
        unsafe {
            asm!(
                "clr r26",
                "mul r19, r21",
                "movw r24, r0",
                "mul r18, r20",
                "movw r22, r0",
                "mul r19, r20",
                "add r23, r0",
                "adc r24, r1",
                "adc r25, r26",
                "mul r21, r18",
                "add r23, r0",
                "adc r24, r1",
                "adc r25, r26",
                "clr r1",
                in("r19r18") a,
                in("r21r20") b,
                out("r23r22") low,
                out("r25r24") high,
                out("r26") _,
                options(pure, nomem, nostack)
            );
        }
        (high as u32) << 16 | low as u32
    }
    #[cfg(not(target_arch = "avr"))]
    {
        a as u32 * b as u32
    }
}

/// Exact product of a signed and an unsigned 16-bit number.
#[inline(always)]
pub fn mul_i16_u16(a: i16, b: u16) -> i32 {
    #[cfg(target_arch = "avr")]
    {
        let (low, high): (u16, u16);
        // SAFETY: pure register arithmetic; r1, which the compiler holds at zero, is zero again at the end.
        unsafe {
            asm!(
                "clr r26",
                "mulsu r19, r21",
                "movw r24, r0",
                "mul r18, r20",
                "movw r22, r0",
                "mulsu r19, r20",
                "sbc r25, r26",
                "add r23, r0",
                "adc r24, r1",
                "adc r25, r26",
                "mul r21, r18",
                "add r23, r0",
                "adc r24, r1",
                "adc r25, r26",
                "clr r1",
                in("r19r18") a,
                in("r21r20") b,
                out("r23r22") low,
                out("r25r24") high,
                out("r26") _,
                options(pure, nomem, nostack)
            );
        }
        ((high as u32) << 16 | low as u32) as i32
    }
    #[cfg(not(target_arch = "avr"))]
    {
        a as i32 * b as i32
    }
}

/// The nearest 16-bit number: what a value beyond the range becomes.
#[inline(always)]
pub fn saturate_i16(value: i32) -> i16 {
    if value as i16 as i32 == value {
        value as i16
    } else if value < 0 {
        i16::MIN
    } else {
        i16::MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn products_are_exact(a: i16, b: i16) {
            prop_assert_eq!(mul_i16(a, b) as i64, a as i64 * b as i64);
            prop_assert_eq!(mul_i16_u16(a, b as u16) as i64, a as i64 * b as u16 as i64);
            prop_assert_eq!(mul_u16(a as u16, b as u16) as i64, a as u16 as i64 * b as u16 as i64);
        }

        #[test]
        fn saturation_is_the_clamp(value: i32) {
            prop_assert_eq!(saturate_i16(value) as i32, value.clamp(i16::MIN as i32, i16::MAX as i32));
        }
    }
}
