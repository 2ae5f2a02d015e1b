//! L293D: 20 kHz PWM from Timer1, sign and magnitude.
//!
//! Braking wiring (default): PWM on IN1, direction on IN2, EN steady. Forward the output is high for the duty and low
//! (brake) for the rest; reverse, with IN2 high, it is inverted: low for the duty. Both ways the drive phase begins
//! with the period. Coasting wiring: PWM on EN, IN1 and IN2 give the direction.

use avr_device::atmega328p::Peripherals;
use motorbench_board::pins;
use motorbench_core::control_loop::Drive;
use motorbench_core::excitation::Bridge;

/// TCCR1A: mode 14 needs WGM11, with OC1A disconnected, high or low for the duty.
const DISCONNECTED: u8 = 0b0000_0010;
const HIGH_FOR_DUTY: u8 = 0b1000_0010;
const LOW_FOR_DUTY: u8 = 0b1100_0010;

/// TCCR1B: mode 14, stopped; and the processor's clock.
const STOPPED: u8 = 0b0001_1000;
const CLOCK: u8 = 0b0000_0001;

/// Bridge off at duty zero; the timer waits for [`run`].
pub fn start(p: &Peripherals) {
    let enable = pins::BRIDGE_ENABLE.mask();
    let outputs = pins::BRIDGE_DIRECTION.mask() | pins::BRIDGE_PWM.mask();
    // SAFETY: any value is valid for port and timer registers. OCR1B is set before the mode that would buffer it, ICR1, the
    // top, in the mode that uses it.
    unsafe {
        p.PORTD.portd().modify(|r, w| w.bits(r.bits() & !enable));
        p.PORTD.ddrd().modify(|r, w| w.bits(r.bits() | enable));
        p.PORTB.portb().modify(|r, w| w.bits(r.bits() & !outputs));
        p.PORTB.ddrb().modify(|r, w| w.bits(r.bits() | outputs));
        p.TC1.ocr1b().write(|w| w.bits(super::adc::TRIGGER));
        p.TC1.tccr1a().write(|w| w.bits(DISCONNECTED));
        p.TC1.tccr1b().write(|w| w.bits(STOPPED));
        p.TC1.icr1().write(|w| w.bits(motorbench_core::HARDWARE.pwm_steps - 1));
    }
}

/// Begins the first period.
pub fn run(p: &Peripherals) {
    // SAFETY: the mode as it is, with the clock.
    p.TC1.tccr1b().write(|w| unsafe { w.bits(STOPPED | CLOCK) });
}

/// Everything off at once: for the panic handler.
pub fn off(p: &Peripherals) {
    let enable = pins::BRIDGE_ENABLE.mask();
    // SAFETY: any value is valid for these registers.
    unsafe {
        p.PORTD.portd().modify(|r, w| w.bits(r.bits() & !enable));
        p.TC1.tccr1a().write(|w| w.bits(DISCONNECTED));
        p.PORTB.portb().modify(|r, w| w.bits(r.bits() & !pins::BRIDGE_PWM.mask()));
    }
}

/// Applies what the tick decided. `coasting` is the wiring.
#[inline(always)]
pub fn apply(p: &Peripherals, drive: &Drive, coasting: bool) {
    let driving = drive.bridge == Bridge::Drive && drive.duty != 0;
    let on = drive.bridge != Bridge::Coast;
    if driving {
        set_compare(p, drive.duty.unsigned_abs() - 1);
    }
    let reverse = driving && drive.duty < 0;
    if coasting {
        wire_coasting(p, driving, reverse, on);
    } else {
        let output = match (driving, reverse) {
            (false, _) => DISCONNECTED,
            (true, false) => HIGH_FOR_DUTY,
            (true, true) => LOW_FOR_DUTY,
        };
        set_pin_b(p, pins::BRIDGE_DIRECTION.mask(), reverse);
        // SAFETY: one of the three modes above.
        p.TC1.tccr1a().write(|w| unsafe { w.bits(output) });
        set_pin_d(p, pins::BRIDGE_ENABLE.mask(), on);
    }
}

/// EN carries the PWM; with both inputs low, an enabled bridge brakes.
fn wire_coasting(p: &Peripherals, driving: bool, reverse: bool, on: bool) {
    set_pin_d(p, pins::BRIDGE_ENABLE.mask(), driving && !reverse);
    set_pin_b(p, pins::BRIDGE_DIRECTION.mask(), reverse);
    set_pin_b(p, pins::BRIDGE_PWM.mask(), on && !driving);
    let output = if driving { HIGH_FOR_DUTY } else { DISCONNECTED };
    // SAFETY: one of the modes above.
    p.TC1.tccr1a().write(|w| unsafe { w.bits(output) });
}

/// Writes the compare value; the chip takes it over at the end of the period.
#[inline(always)]
fn set_compare(p: &Peripherals, value: u16) {
    // The two halves go through a register that reading any other 16-bit timer register would overwrite.
    // SAFETY: any value up to the top is valid.
    avr_device::interrupt::free(|_| p.TC1.ocr1a().write(|w| unsafe { w.bits(value) }));
}

#[inline(always)]
fn set_pin_b(p: &Peripherals, mask: u8, high: bool) {
    // SAFETY: any value is valid for a port's output register.
    p.PORTB.portb().modify(|r, w| unsafe { w.bits(if high { r.bits() | mask } else { r.bits() & !mask }) });
}

#[inline(always)]
fn set_pin_d(p: &Peripherals, mask: u8, high: bool) {
    // SAFETY: any value is valid for a port's output register.
    p.PORTD.portd().modify(|r, w| unsafe { w.bits(if high { r.bits() | mask } else { r.bits() & !mask }) });
}
