//! The motorbench firmware for the Arduino Uno.
//!
//! Short interrupt handlers take the encoder's edges and the current's samples. The timer's handler runs the control loop
//! (`board::tick`). The main loop, here, has console, telemetry and settings. The wiring is in
//! `motorbench_board::pins`, the commands are listed by `help` on the console (500,000 baud). Built for the host, this
//! program prints the pin map, the commands and the settings.
#![cfg_attr(target_arch = "avr", no_std, no_main, feature(abi_avr_interrupt, asm_experimental_arch))]

#[cfg(target_arch = "avr")]
mod board;

#[cfg(target_arch = "avr")]
mod firmware {
    use super::board::{self, eeprom::ChipEeprom, serial, stack, tick, watchdog};
    use motorbench_core::console::{Console, Counters, Machine, ResetCause};
    use motorbench_core::control_loop::duty_scale;
    use motorbench_core::message::{Request, Sample};
    use motorbench_core::settings::{BuildError, Settings};

    /// Ticks that a byte may wait: 20 ms, at 2 kHz 10 ms.
    const LONGEST_WAIT: u8 = 20;

    /// The machine the console talks to.
    struct Uno {
        memory: ChipEeprom,
        /// Of the latest sample.
        supply: i16,
        reset_cause: ResetCause,
        host_spoke: bool,
        /// Bytes that could not be sent; stays at 255.
        unsent: u8,
        /// The last byte could not be sent: no other waits before one can.
        stuck: bool,
        /// [`serial::unread`] when it was last looked at.
        unread: u8,
        /// The supply the scale was worked out for, and the scale: a division for each change, not for each round.
        scaled_supply: i16,
        duty_scale: u16,
    }

    impl Uno {
        /// Sends the next sample, if one has come and is wanted. Not inlined: between two samples the stack has its room.
        #[inline(never)]
        fn send_sample(&mut self, console: &mut Console) {
            let mut sample = Sample::default();
            if tick::take_sample(&mut sample) {
                self.supply = sample.supply;
                console.telemetry(&sample, self);
            }
        }

        /// Shows the tick that the main loop goes round.
        fn keep_alive(&mut self) {
            if self.supply != self.scaled_supply {
                self.scaled_supply = self.supply;
                self.duty_scale = duty_scale(self.supply);
            }
            tick::keep_alive(core::mem::take(&mut self.host_spoke), self.duty_scale);
        }
    }

    impl Machine for Uno {
        type Memory = ChipEeprom;

        fn request(&mut self, request: Request) {
            self.keep_alive();
            tick::request(request);
        }

        fn look(&mut self, sample: &mut Sample, counters: &mut Counters) {
            self.keep_alive();
            tick::with_loop(|control| {
                *sample = *control.sample();
                counters.illegal_transitions = control.illegal_transitions();
                counters.since_trip = control.since_trip();
                (counters.zeroing, counters.zero_ok) = control.current_zero();
            });
            counters.overruns = serial::overruns();
            counters.unsent = self.unsent;
            counters.dropped = tick::dropped();
            counters.stack_free = stack::never_used();
            counters.reset_cause = self.reset_cause;
        }

        fn configure(&mut self, settings: &Settings) -> Result<(), BuildError> {
            tick::configure(settings)
        }

        fn memory(&mut self) -> &mut ChipEeprom {
            &mut self.memory
        }

        fn send(&mut self, byte: u8) {
            // A long reply keeps the main loop for longer than a hang may last.
            tick::mark_alive();
            let begun = tick::count();
            while !serial::try_write(byte) {
                tick::mark_alive();
                if self.stuck || tick::count().wrapping_sub(begun) > LONGEST_WAIT {
                    self.stuck = true;
                    self.unsent = self.unsent.saturating_add(1);
                    return;
                }
            }
            self.stuck = false;
        }

        fn host_spoke(&mut self) {
            self.host_spoke = true;
        }

        fn listen(&mut self) {
            let unread = serial::unread();
            // Whatever comes meanwhile counts: what it says is known when the reply is over. Of a host that is gone
            // nothing comes, and it is missed in time.
            if unread > core::mem::replace(&mut self.unread, unread) {
                self.host_spoke = true;
            }
            self.keep_alive();
        }
    }

    #[avr_device::entry]
    fn main() -> ! {
        let peripherals = board::registers();
        board::bridge::start(&peripherals);
        stack::paint();
        let reset_cause = watchdog::reset_cause(&peripherals);
        watchdog::start(&peripherals);
        let mut uno = Uno {
            memory: ChipEeprom(board::registers().EEPROM),
            supply: 0,
            reset_cause,
            host_spoke: false,
            unsent: 0,
            stuck: false,
            unread: 0,
            scaled_supply: 0,
            duty_scale: u16::MAX,
        };
        board::start(&peripherals);
        avr_device::asm::wdr();
        tick::prepare();
        let mut console = Console::default();
        if console.start(&mut uno).is_err() {
            watchdog::panicked(&peripherals)
        }
        avr_device::asm::wdr();
        tick::run(&peripherals);
        // SAFETY: every handler's state has been set up.
        unsafe { avr_device::interrupt::enable() };
        uno.request(Request::ZeroCurrent);
        // Nobody arms before the zero of the current is known: a drive would spoil it.
        while tick::with_loop(|control| control.current_zero().0) {
            uno.keep_alive();
            tick::skip_samples();
        }
        console.greet(&mut uno);
        loop {
            uno.keep_alive();
            uno.send_sample(&mut console);
            while let Some(byte) = serial::read() {
                console.receive(byte, &mut uno);
                // Several lines may wait, each of which takes some ticks. A recording needs the room of their samples.
                if byte < b' ' && console.is_silent() {
                    tick::skip_samples();
                }
            }
            console.poll(&mut uno);
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
    use motorbench_board::pins::PIN_MAP;
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
