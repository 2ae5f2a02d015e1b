//! THE pin map: what is wired where on the Uno.
//!
//! The firmware takes its port bits from here. The simulated chip wires its motor to the same constants. A test holds
//! the table of `docs/how-to/hardware.md` against [`PIN_MAP`].

/// One pin of the ATmega328P with its name on the Uno's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// What is printed on the board: `D2`, `A0`.
    pub arduino: &'static str,
    /// Port letter: `B`, `C` or `D`.
    pub port: char,
    /// Bit within the port, 0..=7.
    pub bit: u8,
    /// What is connected with the default (braking) bridge wiring.
    pub role: &'static str,
}

impl Pin {
    const fn new(arduino: &'static str, port: char, bit: u8, role: &'static str) -> Self {
        Self { arduino, port, bit, role }
    }

    /// The pin as a mask in its port registers.
    pub const fn mask(&self) -> u8 {
        1 << self.bit
    }
}

/// Encoder channel A; INT0, any edge.
pub const ENCODER_A: Pin = Pin::new("D2", 'D', 2, "encoder A (INT0)");
/// Encoder channel B; INT1, any edge. The interrupt handler relies on B standing one bit above A.
pub const ENCODER_B: Pin = Pin::new("D3", 'D', 3, "encoder B (INT1)");
/// Emergency stop, normally open to ground; the pull-up of the chip keeps it high.
pub const EMERGENCY_STOP: Pin = Pin::new("D4", 'D', 4, "emergency stop to ground");
/// L293D enable, with a pull-down so that the bridge is off in reset. Coasting wiring: IN1.
pub const BRIDGE_ENABLE: Pin = Pin::new("D7", 'D', 7, "L293D EN1, 10 kohm pull-down");
/// L293D IN2: the direction.
pub const BRIDGE_DIRECTION: Pin = Pin::new("D8", 'B', 0, "L293D IN2");
/// L293D IN1: the 20 kHz PWM of OC1A. Coasting wiring: EN1, with the pull-down.
pub const BRIDGE_PWM: Pin = Pin::new("D9", 'B', 1, "L293D IN1 (OC1A, 20 kHz PWM)");
/// ACS712 output.
pub const CURRENT_SENSE: Pin = Pin::new("A0", 'C', 0, "ACS712 OUT");
/// Tachogenerator behind its divider by two.
pub const TACHOGENERATOR: Pin = Pin::new("A1", 'C', 1, "tachogenerator / 2");
/// Motor supply behind its divider.
pub const SUPPLY_SENSE: Pin = Pin::new("A2", 'C', 2, "motor supply divider");
/// Serial console, through the Uno's USB bridge.
pub const SERIAL_RX: Pin = Pin::new("D0", 'D', 0, "USB serial in");
/// Serial console, through the Uno's USB bridge.
pub const SERIAL_TX: Pin = Pin::new("D1", 'D', 1, "USB serial out");

/// Every pin in use, in the order of the header.
pub const PIN_MAP: [Pin; 11] = [
    SERIAL_RX,
    SERIAL_TX,
    ENCODER_A,
    ENCODER_B,
    EMERGENCY_STOP,
    BRIDGE_ENABLE,
    BRIDGE_DIRECTION,
    BRIDGE_PWM,
    CURRENT_SENSE,
    TACHOGENERATOR,
    SUPPLY_SENSE,
];
