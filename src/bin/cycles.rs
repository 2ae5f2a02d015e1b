//! What the control core costs on the chip. Each block lies between two marks in GPIOR0. Inputs and outputs go through
//! volatile memory, so that the compiler moves nothing out of the marks and computes nothing beforehand. The benchmark runs
//! it on the simulated chip; the marks themselves cost one cycle.
#![cfg_attr(target_arch = "avr", no_std, no_main, feature(asm_experimental_arch))]

#[cfg(target_arch = "avr")]
mod on_chip {
    use core::cell::UnsafeCell;
    use core::mem::MaybeUninit;
    use motorbench_core::limits::Limits;
    use motorbench_core::lqr::{LqrConfig, LqrState};
    use motorbench_core::pid::{PidConfig, PidState};
    use motorbench_core::settings::{Param, Settings};

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo) -> ! {
        loop {
            avr_device::asm::nop();
        }
    }

    /// A place in memory that the compiler can neither foresee nor forget; the blocks' configuration and state live in
    /// such places, as they do in the firmware.
    struct Place<T>(UnsafeCell<MaybeUninit<T>>);

    // SAFETY: no interrupts, one thread.
    unsafe impl<T> Sync for Place<T> {}

    impl<T> Place<T> {
        const fn new() -> Self {
            Self(UnsafeCell::new(MaybeUninit::uninit()))
        }

        fn put(&self, value: T) {
            // SAFETY: no reference to the content is alive while the program prepares. The assembly does nothing; having
            // been given the address, it makes the compiler forget what stands there.
            unsafe {
                (*self.0.get()).write(value);
                core::arch::asm!("; {}", in(reg_ptr) self.0.get());
            }
        }

        #[expect(clippy::mut_from_ref, reason = "one reference at a time, see Sync")]
        #[inline(always)]
        fn get(&self) -> &mut T {
            // SAFETY: put before; one reference at a time.
            unsafe { (*self.0.get()).assume_init_mut() }
        }
    }

    /// Marks the beginning of block `number`, or with 0 the end.
    #[inline(always)]
    fn mark(number: u8) {
        // SAFETY: writes a general purpose register; as assembly it also keeps memory accesses on their side.
        unsafe { core::arch::asm!("out 0x1e, {}", in(reg) number) };
    }

    static SPEED_PID: Place<PidConfig> = Place::new();
    static POSITION_PID: Place<PidConfig> = Place::new();
    static SPEED_LQR: Place<LqrConfig> = Place::new();
    static POSITION_LQR: Place<LqrConfig> = Place::new();
    static PID: Place<PidState> = Place::new();
    static LQR: Place<LqrState> = Place::new();
    static X: Place<i16> = Place::new();
    static Y: Place<i16> = Place::new();
    static LIMITS: Place<Limits> = Place::new();
    static RESULT: Place<i16> = Place::new();

    /// Measures `$work`, which may use `x` and `y`.
    macro_rules! measure {
        ($number:literal, |$x:ident, $y:ident| $work:expr) => {{
            mark($number);
            let ($x, $y) = (*X.get(), *Y.get());
            *RESULT.get() = $work;
            mark(0);
        }};
    }

    fn prepare() -> Result<(), motorbench_core::settings::BuildError> {
        let mut settings = Settings::defaults();
        settings.values[Param::SpeedKd as usize] = 0.001;
        SPEED_PID.put(PidConfig::speed(&settings)?);
        POSITION_PID.put(PidConfig::position(&settings)?);
        SPEED_LQR.put(LqrConfig::speed(&settings)?);
        POSITION_LQR.put(LqrConfig::position(&settings)?);
        PID.put(PidState::default());
        LQR.put(LqrState::default());
        LIMITS.put(Limits { low: -12000, high: 12000, previous: 0, align: false });
        Ok(())
    }

    #[avr_device::entry]
    fn main() -> ! {
        if prepare().is_err() {
            mark(0xff);
        }
        let mut x = 1i16;
        for _ in 0..200u8 {
            x = x.wrapping_mul(25173).wrapping_add(13849);
            X.put(x);
            Y.put(x.rotate_left(7));
            measure!(1, |x, y| PID.get().step_speed(SPEED_PID.get(), x, y, LIMITS.get()));
            measure!(2, |x, y| PID.get().step_position(POSITION_PID.get(), x, y, x, LIMITS.get()));
            measure!(3, |x, y| LQR.get().step_speed(SPEED_LQR.get(), x, y, x, LIMITS.get()));
            measure!(4, |x, y| LQR.get().step_position(POSITION_LQR.get(), x, y, x, LIMITS.get()));
        }
        loop {
            avr_device::asm::nop();
        }
    }
}

#[cfg(not(target_arch = "avr"))]
fn main() {
    eprintln!("This program runs on the chip; `cargo bench` runs it there.");
}
