//! The control core on `arduino-hal`: its `Peripherals`, its `pins!`, its serial port, and motorbench's control loop.
//!
//! The loop runs at 1 kHz by waiting, not from a timer. That is enough to show that both worlds' types are the same. It
//! is a start if you already have a program on `arduino-hal`. It measures the current and reports it; the motor stays
//! off.
#![no_std]
#![no_main]

use motorbench_core::control_loop::{ControlLoop, Inputs, LoopConfig, duty_scale};
use motorbench_core::encoder::Edges;
use motorbench_core::excitation::Bridge;
use motorbench_core::message::Request;
use motorbench_core::settings::Settings;
use panic_halt as _;

#[arduino_hal::entry]
fn main() -> ! {
    // The register types are avr-device's, as in motorbench's own firmware.
    let peripherals: arduino_hal::Peripherals = arduino_hal::Peripherals::take().unwrap();
    let pins = arduino_hal::pins!(peripherals);
    let mut serial = arduino_hal::default_serial!(peripherals, pins, 57600);
    let mut adc = arduino_hal::Adc::new(peripherals.ADC, Default::default());
    let current_sense = pins.a0.into_analog_input(&mut adc);
    let mut enable = pins.d7.into_output();
    let stop_pin = pins.d4.into_pull_up_input();

    let Ok(config) = LoopConfig::build(&Settings::defaults()) else {
        // A test of the core holds that the defaults fit.
        panic!()
    };
    let mut control = ControlLoop::new(config, Edges::default());
    let mut request = Some(Request::ZeroCurrent);
    loop {
        let current_sum = (0..8).map(|_| current_sense.analog_read(&mut adc)).sum();
        let stop = if stop_pin.is_low() { Inputs::STOP_CLOSED } else { 0 };
        let inputs = Inputs {
            current_sum,
            duty_scale: duty_scale(12 * 1024),
            flags: Inputs::MAIN_LOOP_ALIVE | stop,
            ..Inputs::default()
        };
        let drive = control.tick(request.take(), &inputs);
        if drive.bridge == Bridge::Coast {
            enable.set_low();
        }
        let sample = control.sample();
        if sample.tick % 1000 == 0 {
            let _ = ufmt::uwriteln!(&mut serial, "current {} (1/4096 A), trip {}", sample.current, sample.trip as u8);
        }
        arduino_hal::delay_ms(1);
    }
}
