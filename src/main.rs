//! The motorbench firmware for the Arduino Uno.
//!
//! What runs where: the encoder's edges and the current's samples in short interrupt handlers, the control loop in the
//! timer's (`board::tick`), and here, in the main loop, the talking: console, telemetry, settings. The wiring is in
//! `motorbench_core::pins`, the commands are listed by `help` on the console (500,000 baud). Built for the host, this
//! program prints the pin map, the commands and the settings.
#![cfg_attr(target_arch = "avr", no_std, no_main, feature(abi_avr_interrupt, asm_experimental_arch))]

#[cfg(target_arch = "avr")]
mod board;

#[cfg(target_arch = "avr")]
mod firmware {
    use super::board::{self, eeprom::ChipEeprom, serial, tick, watchdog};
    use motorbench_core::bring_up;
    use motorbench_core::console::{Counters, Machine, ResetCause};
    use motorbench_core::message::{Request, Sample};
    use motorbench_core::settings::{BuildError, Settings};
    use motorbench_core::storage;

    /// The machine the console talks to.
    struct Uno {
        memory: ChipEeprom,
        sample: Sample,
        reset_cause: ResetCause,
        host_spoke: bool,
    }

    impl Uno {
        /// Takes the samples that have come; the latest stays.
        fn take_sample(&mut self) -> Option<Sample> {
            let sample = tick::next_sample()?;
            self.sample = sample;
            Some(sample)
        }

        /// Shows the tick that the main loop goes round.
        fn keep_alive(&mut self) {
            tick::keep_alive(core::mem::take(&mut self.host_spoke), self.sample.supply);
        }
    }

    impl Machine for Uno {
        type Memory = ChipEeprom;

        fn request(&mut self, request: Request) {
            self.keep_alive();
            tick::request(request);
        }

        fn sample(&mut self) -> Sample {
            self.keep_alive();
            tick::with_loop(|control| *control.sample())
        }

        fn configure(&mut self, settings: &Settings) -> Result<(), BuildError> {
            tick::configure(settings)
        }

        fn counters(&mut self) -> Counters {
            let (illegal_transitions, (zeroing, zero_ok)) =
                tick::with_loop(|control| (control.illegal_transitions(), control.current_zero()));
            Counters {
                illegal_transitions,
                overruns: serial::overruns(),
                dropped: tick::dropped(),
                reset_cause: self.reset_cause,
                zeroing,
                zero_ok,
            }
        }

        fn memory(&mut self) -> &mut ChipEeprom {
            &mut self.memory
        }

        fn send(&mut self, bytes: &[u8]) {
            for &byte in bytes {
                while !serial::try_write(byte) {
                    tick::mark_alive();
                }
            }
        }

        fn host_spoke(&mut self) {
            self.host_spoke = true;
        }
    }

    /// The settings to start with: the saved ones if they are whole and fit, else the defaults.
    fn starting_point(memory: &mut ChipEeprom) -> Settings {
        if let Some(settings) = storage::load(memory)
            && tick::prepare(&settings).is_ok()
        {
            return settings;
        }
        let settings = Settings::defaults();
        if tick::prepare(&settings).is_err() {
            // A test of the core holds that the defaults fit.
            watchdog::panicked(&board::registers())
        }
        settings
    }

    #[avr_device::entry]
    fn main() -> ! {
        let peripherals = board::registers();
        board::bridge::start(&peripherals);
        let reset_cause = watchdog::reset_cause(&peripherals);
        watchdog::start(&peripherals);
        let mut uno = Uno {
            memory: ChipEeprom(board::registers().EEPROM),
            sample: Sample::default(),
            reset_cause,
            host_spoke: false,
        };
        board::start(&peripherals);
        avr_device::asm::wdr();
        starting_point(&mut uno.memory);
        let mut talk = bring_up::Talk::default();
        avr_device::asm::wdr();
        tick::enable(&peripherals);
        // SAFETY: every handler's state has been set up.
        unsafe { avr_device::interrupt::enable() };
        uno.request(Request::ZeroCurrent);
        loop {
            uno.keep_alive();
            if let Some(sample) = uno.take_sample() {
                talk.telemetry(&sample, &mut uno);
            }
            while let Some(byte) = serial::read() {
                talk.receive(byte, &mut uno);
            }
            board::idle(&peripherals);
        }
    }

    #[panic_handler]
    fn panic(_: &core::panic::PanicInfo) -> ! {
        watchdog::panicked(&board::registers())
    }
}

#[cfg(not(target_arch = "avr"))]
fn main() {
    use motorbench_core::pins::PIN_MAP;
    println!(
        "motorbench firmware {}: this is the host build; it prints what the Uno knows.",
        env!("CARGO_PKG_VERSION")
    );
    println!("\nPins");
    for pin in PIN_MAP {
        println!("  {:3} P{}{}  {}", pin.arduino, pin.port, pin.bit, pin.role);
    }
    print!("\n{}", motorbench_core::console::reference());
}
