//! The multiplications of the control path.
//!
//! The ATmega328P multiplies 8 by 8 bits in two cycles. The compiler turns `i16 as i32 * i16 as i32` into a call of the
//! general 32-bit product (81 cycles); composed of four 8-bit products it takes 20. Every function here is exact and
//! cannot overflow; on the host it is the plain product, and a test on the simulated chip compares the two.

#[cfg(target_arch = "avr")]
use core::arch::asm;

/// Adds a product of a high and a low byte in the middle of a 32-bit number in r25:r22; of a signed high byte, it may be
/// negative.
#[cfg(target_arch = "avr")]
macro_rules! add_middle {
    (signed $high:literal $low:literal) => {
        concat!("mulsu ", $high, ", ", $low, "\nsbc r25, r26\nadd r23, r0\nadc r24, r1\nadc r25, r26")
    };
    (unsigned $high:literal $low:literal) => {
        concat!("mul ", $high, ", ", $low, "\nadd r23, r0\nadc r24, r1\nadc r25, r26")
    };
}

/// The product of two 16-bit numbers from four products of bytes; by itself, or added to a sum.
#[cfg(target_arch = "avr")]
macro_rules! product {
    ($top:literal, $a_sign:ident $a:expr, $b_sign:ident $b:expr) => {{
        let (low, high): (u16, u16);
        // SAFETY: pure register arithmetic; r1, which the compiler holds at zero, is zero again at the end.
        unsafe {
            asm!(
                "clr r26",
                concat!($top, " r19, r21"),
                "movw r24, r0",
                "mul r18, r20",
                "movw r22, r0",
                add_middle!($a_sign "r19" "r20"),
                add_middle!($b_sign "r21" "r18"),
                "clr r1",
                in("r19r18") $a,
                in("r21r20") $b,
                out("r23r22") low,
                out("r25r24") high,
                out("r26") _,
                options(pure, nomem, nostack)
            );
        }
        from_halves(low, high)
    }};
    ($sum:expr, $top:literal, $a_sign:ident $a:expr, $b_sign:ident $b:expr) => {{
        let (mut low, mut high) = halves($sum);
        // SAFETY: pure register arithmetic; r1, which the compiler holds at zero, is zero again at the end.
        unsafe {
            asm!(
                "clr r26",
                concat!($top, " r19, r21"),
                "add r24, r0",
                "adc r25, r1",
                "mul r18, r20",
                "add r22, r0",
                "adc r23, r1",
                "adc r24, r26",
                "adc r25, r26",
                add_middle!($a_sign "r19" "r20"),
                add_middle!($b_sign "r21" "r18"),
                "clr r1",
                inout("r23r22") low,
                inout("r25r24") high,
                in("r19r18") $a,
                in("r21r20") $b,
                out("r26") _,
                options(pure, nomem, nostack)
            );
        }
        from_halves(low, high)
    }};
}

/// Exact product of two signed 16-bit numbers.
#[inline(always)]
pub fn mul_i16(a: i16, b: i16) -> i32 {
    #[cfg(target_arch = "avr")]
    return product!("muls", signed a, signed b);
    #[cfg(not(target_arch = "avr"))]
    return a as i32 * b as i32;
}

/// Exact product of two unsigned 16-bit numbers.
#[inline(always)]
pub fn mul_u16(a: u16, b: u16) -> u32 {
    #[cfg(target_arch = "avr")]
    return product!("mul", unsigned a, unsigned b) as u32;
    #[cfg(not(target_arch = "avr"))]
    return a as u32 * b as u32;
}

/// Exact product of a signed and an unsigned 16-bit number.
#[inline(always)]
pub fn mul_i16_u16(a: i16, b: u16) -> i32 {
    #[cfg(target_arch = "avr")]
    return product!("mulsu", signed a, unsigned b);
    #[cfg(not(target_arch = "avr"))]
    return a as i32 * b as i32;
}

/// [`mul_i16`] by a call: 10 cycles slower, a fifth of the size; for what is not done in every tick.
#[inline(never)]
pub fn call_mul_i16(a: i16, b: i16) -> i32 {
    mul_i16(a, b)
}

/// [`mul_i16_u16`] by a call.
#[inline(never)]
pub fn call_mul_i16_u16(a: i16, b: u16) -> i32 {
    mul_i16_u16(a, b)
}

/// [`saturate_i16`] by a call.
#[inline(never)]
pub fn call_saturate_i16(value: i32) -> i16 {
    saturate_i16(value)
}

/// One product of [`dot`]: the next factor in r19:r18, the signal in r21:r20.
#[cfg(target_arch = "avr")]
macro_rules! dot_term {
    ($signal:literal, $high:literal, $low:literal) => {
        concat!(
            "ld r18, Z+\nld r19, Z+\nmovw r20, {",
            $signal,
            "}\nmuls r19, r21\n",
            $high,
            "\nmul r18, r20\n",
            $low,
            "\n",
            add_middle!(signed "r19" "r20"),
            "\n",
            add_middle!(signed "r21" "r18")
        )
    };
}

/// The sum of three products, modulo 2^32; exact if it stays within 32 bits, which the caller has to see to.
#[inline(always)]
pub fn dot(factors: &[i16; 3], signals: [i16; 3]) -> i32 {
    #[cfg(target_arch = "avr")]
    {
        let (low, high): (u16, u16);
        // SAFETY: reads the three factors; else register arithmetic. r1, which the compiler holds at zero, is zero
        // again at the end.
        unsafe {
            asm!(
                "clr r26",
                dot_term!("first", "movw r24, r0", "movw r22, r0"),
                dot_term!("second", "add r24, r0\nadc r25, r1",
                    "add r22, r0\nadc r23, r1\nadc r24, r26\nadc r25, r26"),
                dot_term!("third", "add r24, r0\nadc r25, r1",
                    "add r22, r0\nadc r23, r1\nadc r24, r26\nadc r25, r26"),
                "clr r1",
                first = in(reg_pair) signals[0],
                second = in(reg_pair) signals[1],
                third = in(reg_pair) signals[2],
                inout("Z") factors.as_ptr() => _,
                out("r19r18") _,
                out("r21r20") _,
                out("r23r22") low,
                out("r25r24") high,
                out("r26") _,
                options(pure, readonly, nostack)
            );
        }
        from_halves(low, high)
    }
    #[cfg(not(target_arch = "avr"))]
    {
        factors.iter().zip(signals).fold(0, |sum: i32, (&a, b)| sum.wrapping_add(a as i32 * b as i32))
    }
}

/// `sum + a * b` for an unsigned `b`; the caller sees to it that it stays within 32 bits.
#[inline(always)]
pub fn multiply_add_u16(sum: i32, a: i16, b: u16) -> i32 {
    #[cfg(target_arch = "avr")]
    return product!(sum, "mulsu", signed a, unsigned b);
    #[cfg(not(target_arch = "avr"))]
    return sum + a as i32 * b as i32;
}

/// The sum, or the nearest 32-bit number where it does not fit.
///
/// The compiler's own takes four times as long: the processor's overflow flag says what it computes by comparing.
#[inline(always)]
pub fn saturating_add_i32(a: i32, b: i32) -> i32 {
    #[cfg(target_arch = "avr")]
    {
        let (mut low, mut high) = halves(a);
        let (b_low, b_high) = halves(b);
        // SAFETY: pure register arithmetic. After an overflow the sign is the wrong one.
        unsafe {
            asm!(
                "add r22, r18",
                "adc r23, r19",
                "adc r24, r20",
                "adc r25, r21",
                "brvc 1f",
                "lsl r25",
                "sbc r22, r22",
                "mov r23, r22",
                "mov r24, r22",
                "mov r25, r22",
                "subi r25, 0x80",
                "1:",
                inout("r23r22") low,
                inout("r25r24") high,
                in("r19r18") b_low,
                in("r21r20") b_high,
                options(pure, nomem, nostack)
            );
        }
        from_halves(low, high)
    }
    #[cfg(not(target_arch = "avr"))]
    {
        a.saturating_add(b)
    }
}

/// Adds or subtracts two 16-bit numbers; after an overflow the sign is the wrong one.
#[cfg(target_arch = "avr")]
macro_rules! saturating {
    ($low:literal, $high:literal, $a:expr, $b:expr) => {{
        let mut result = $a;
        // SAFETY: pure register arithmetic.
        unsafe {
            asm!(
                concat!($low, " r24, {b:l}"),
                concat!($high, " r25, {b:h}"),
                "brvc 1f",
                "lsl r25",
                "sbc r24, r24",
                "mov r25, r24",
                "subi r25, 0x80",
                "1:",
                inout("r25r24") result,
                b = in(reg_pair) $b,
                options(pure, nomem, nostack)
            );
        }
        result
    }};
}

/// The sum, or the nearest 16-bit number where it does not fit.
#[inline(always)]
pub fn saturating_add_i16(a: i16, b: i16) -> i16 {
    #[cfg(target_arch = "avr")]
    return saturating!("add", "adc", a, b);
    #[cfg(not(target_arch = "avr"))]
    return a.saturating_add(b);
}

/// The difference, or the nearest 16-bit number where it does not fit.
#[inline(always)]
pub fn saturating_sub_i16(a: i16, b: i16) -> i16 {
    #[cfg(target_arch = "avr")]
    return saturating!("sub", "sbc", a, b);
    #[cfg(not(target_arch = "avr"))]
    return a.saturating_sub(b);
}

/// `value / 256`, rounded down, or the nearest 16-bit number.
#[inline(always)]
pub fn saturate_shift_8(value: i32) -> i16 {
    #[cfg(target_arch = "avr")]
    {
        let (low, mut high) = halves(value);
        let mut result = low;
        // SAFETY: pure register arithmetic: the top byte must be the sign of the one below it.
        unsafe {
            asm!(
                "mov r22, r23",
                "mov r23, r24",
                "lsl r24",
                "sbc r24, r24",
                "cp r24, r25",
                "breq 1f",
                "lsl r25",
                "sbc r22, r22",
                "com r22",
                "mov r23, r22",
                "subi r23, 0x80",
                "1:",
                inout("r23r22") result,
                inout("r25r24") high,
                options(pure, nomem, nostack)
            );
        }
        let _ = high;
        result as i16
    }
    #[cfg(not(target_arch = "avr"))]
    {
        saturate_i16(value >> 8)
    }
}

/// Low and high half, as registers hold them.
#[cfg(target_arch = "avr")]
#[inline(always)]
fn halves(value: i32) -> (u16, u16) {
    (value as u16, (value as u32 >> 16) as u16)
}

/// The number of two halves.
#[cfg(target_arch = "avr")]
#[inline(always)]
fn from_halves(low: u16, high: u16) -> i32 {
    ((high as u32) << 16 | low as u32) as i32
}

/// The nearest 16-bit number: what a value beyond the range becomes.
#[inline(always)]
pub fn saturate_i16(value: i32) -> i16 {
    #[cfg(target_arch = "avr")]
    {
        let (mut result, mut high) = halves(value);
        // SAFETY: pure register arithmetic: the upper half must be the sign of the lower.
        unsafe {
            asm!(
                "mov r20, r23",
                "lsl r20",
                "sbc r20, r20",
                "cp r20, r24",
                "cpc r20, r25",
                "breq 1f",
                "lsl r25",
                "sbc r22, r22",
                "com r22",
                "mov r23, r22",
                "subi r23, 0x80",
                "1:",
                inout("r23r22") result,
                inout("r25r24") high,
                out("r20") _,
                options(pure, nomem, nostack)
            );
        }
        let _ = high;
        result as i16
    }
    #[cfg(not(target_arch = "avr"))]
    {
        value.clamp(i16::MIN as i32, i16::MAX as i32) as i16
    }
}

/// The whole part of a number of at most 2^30; zero of others.
#[inline(never)]
#[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
pub fn whole(value: f32) -> i32 {
    if value.abs() <= 1_073_741_824.0 {
        // SAFETY: finite, and within 32 bits.
        return unsafe { value.to_int_unchecked() };
    }
    0
}

/// The functions above on many arguments, for the comparison of chip and host.
pub mod digests {
    use super::*;

    /// How many functions.
    pub const COUNT: usize = 8;

    /// A digest of each function's results on 2,000 arguments, with the corners of the ranges among them.
    pub fn compute() -> [u32; COUNT] {
        let mut digests = [0u32; COUNT];
        let mut random = 1u32;
        for round in 0..2000u16 {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let (mut a, mut b) = ((random >> 16) as i16, random as i16);
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let mut c = random as i32;
            match round & 15 {
                0 => (a, b) = (i16::MIN, i16::MIN),
                1 => (a, b) = (i16::MIN, i16::MAX),
                2 => (a, b) = (i16::MAX, -1),
                3 => (a, b, c) = (0, 1, i32::MIN),
                4 => (a, b, c) = (-1, -1, i32::MAX),
                _ => {}
            }
            let d = (b as i32) << 16 | a as u16 as i32;
            let results = [
                mul_i16(a, b) as u32,
                mul_u16(a as u16, b as u16),
                mul_i16_u16(a, b as u16) as u32,
                dot(&[a, b, c as i16], [b, !a, a >> 2]) as u32,
                multiply_add_u16(c >> 2, a >> 1, b as u16) as u32,
                saturating_add_i32(c, d) as u32,
                saturating_sub_i16(a, b) as u32 ^ (saturating_add_i16(a, b) as u32) << 5,
                saturate_shift_8(c) as u32 ^ (saturate_i16(d) as u32) << 3,
            ];
            for (digest, result) in digests.iter_mut().zip(results) {
                *digest = digest.rotate_left(5) ^ result;
            }
        }
        digests
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
        fn sums_are_exact_or_saturate(sum in -1_000_000_000i32..1_000_000_000, a: i16, b: i16, c: i32, d: i32) {
            let exact: i64 = [(a, b), (c as i16, a / 2), (d as i16, b / 4)].iter().map(|&(x, y)| x as i64 * y as i64).sum();
            prop_assert_eq!(dot(&[a, c as i16, d as i16], [b, a / 2, b / 4]), exact as i32);
            let sum = sum / 2;
            let exact = sum as i64 + (a / 2) as i64 * b as u16 as i64;
            prop_assert_eq!(multiply_add_u16(sum, a / 2, b as u16) as i64, exact);
            prop_assert_eq!(saturating_add_i32(c, d), c.saturating_add(d));
            prop_assert_eq!(saturating_sub_i16(a, b), a.saturating_sub(b));
            prop_assert_eq!(saturating_add_i16(a, b), a.saturating_add(b));
            prop_assert_eq!(saturate_shift_8(c) as i32, (c >> 8).clamp(i16::MIN as i32, i16::MAX as i32));
        }

        #[test]
        fn saturation_is_the_clamp(value: i32) {
            prop_assert_eq!(saturate_i16(value) as i32, value.clamp(i16::MIN as i32, i16::MAX as i32));
        }
    }
}
