//! Trips: what switches the drive off by itself.
//!
//! Checked once a tick, on what was measured in this tick and the voltage of the tick before. Times are counted in
//! ticks, so a trip comes within eight ticks of its time.
//!
//! | trip | condition |
//! |---|---|
//! | over-current, peak | current above `trip_peak` for 5 ms (the L293D's own non-repetitive limit) |
//! | over-current, thermal | square of the current, low-passed with `trip_thermal_time`, above that of `trip_continuous` |
//! | stall | driven, no motion, current above `trip_continuous`, for `trip_stall` |
//! | encoder silent | the voltage implies a speed, see below, for `trip_encoder`, and the encoder shows none |
//! | encoder counts too few | the same, and the encoder shows too little |
//! | encoder lines | edges that go to and fro by one count for 64 ms; or 16 illegal transitions, less one for every 4 ms without any |
//! | runaway | the same as encoder silent, but the encoder shows a speed against the voltage; or that speed does not fall for `trip_runaway` |
//! | sensor range | current signal at a rail for 3 ticks, or a current above `trip_peak` with the drive disarmed |
//! | converter silent | no block of conversions in a tick |
//! | supply range | measured supply outside its limits for 10 ms |
//! | emergency stop | pressed, or its wire broken where it is normally closed |
//! | host lost | silent for `trip_host` while armed |
//! | main loop hung | no sign of the main loop for 100 ms |
//! | stack overflow | the byte below the stack has changed |
//!
//! "Driven" means a voltage above a quarter of the supply setting. Below it a motor may rest in its friction, and the
//! L293D's own drop (2.6 V) may leave nothing to brake with.
//!
//! ## What proves motion
//! A line that is stuck leaves edges, but the count only goes to and fro by one. So a motion is a count that has left its
//! place by more than two. And the motor is a sensor of its own: the voltage that the resistance does not take is back-EMF.
//!
//! ```text
//! |u| - R |i| - k w  >  |u|/4 + max(supply/4, 3 V)        w: measured speed, positive along the voltage
//! ```
//! If all is well, the left side is the drop of the bridge. The right side has what a bridge of bipolar transistors takes.
//! It also has a quarter of the voltage, for a resistance and a torque constant that are 30 % above the settings.
//!
//! With `torque_constant` zero `k w` is not known: then the shaft must stand still or turn against the voltage. With PWM on
//! EN the mean voltage is known near full duty only, so less does not count. Without a current sensor (`winding_time` not
//! zero) the time is eight times as long, because a motor that breaks loose late looks the same.

use crate::arith::{call_mul_i16, mul_i16, mul_i16_u16, saturate_shift_8, saturating_sub_i16};
use crate::control_loop::Inputs;
use crate::encoder::Proof;
use crate::message::Trip;
use crate::quantiser::Quantiser;
use crate::settings::{BuildError, Param, Settings};
use crate::units::{AMPERE, FULL_RANGE, VOLT};

/// Thresholds in bits. Times are in ticks or in looks. There is a look in every fourth tick; for stall, encoder and runaway
/// in every eighth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct TripsConfig {
    peak: i16,
    peak_ticks: u8,
    continuous: i16,
    /// `continuous` squared, in bits of current squared over 2^15.
    heat_limit: i16,
    /// Tick over thermal time, times 2^24; every eighth tick counts.
    heat_rate: u16,
    /// Bits of voltage a bit of current, times 2^8: the resistance.
    resistive: u16,
    /// Bits of voltage a bit of speed, times 2^8: the back-EMF; zero where it is not known.
    back_emf: u16,
    /// Voltage from which the motor counts as driven.
    driven: i16,
    /// Back-EMF, less a quarter of the voltage, from which the motor must be turning.
    turning: i16,
    /// Voltage below which none is implied.
    known_from: i16,
    stall_looks: u16,
    encoder_looks: u16,
    /// Edges to and fro.
    lines_looks: u8,
    runaway_looks: u16,
    supply_low: i16,
    supply_high: i16,
    /// What is looked at of [`Inputs::STOP_CLOSED`], and what then says that it is not pressed.
    stop_mask: u8,
    stop_released: u8,
    host_looks: u16,
    hung_looks: u8,
}

impl TripsConfig {
    /// From the settings `trip_*`, `resistance`, `torque_constant`, `supply` and `emergency_stop`.
    #[inline(always)]
    pub fn quantise(&mut self, q: &mut Quantiser) {
        // 5 ms in ticks; 100 and 64 ms in looks.
        let [peak_ticks, hung_looks, lines_looks] = if q.is_fast() { [10, 50, 32] } else { [5, 25, 16] };
        let continuous = q.bits(Param::TripContinuous);
        self.peak = q.bits(Param::TripPeak);
        self.peak_ticks = peak_ticks;
        self.continuous = continuous;
        self.heat_limit = (call_mul_i16(continuous, continuous) << 1 >> 16) as i16;
        self.heat_rate = heat_rate(q);
        self.resistive = q.of(256.0 * VOLT / AMPERE).times(Param::Resistance).saturate(Param::Resistance, u16::MAX);
        q.of(256.0 * VOLT / FULL_RANGE).times(Param::SpeedRange).times(Param::TorqueConstant);
        // Too small a constant for this format is one that is not known.
        self.back_emf = q.saturate_or_zero(Param::TorqueConstant, u16::MAX);
        let supply = q.bits(Param::SupplyVoltage);
        self.driven = supply >> 2;
        self.turning = self.driven.max(LARGEST_DROP);
        self.known_from = if q.is_on(Param::Wiring) { supply - (supply >> 3) } else { self.driven };
        self.stall_looks = looks(q, Param::TripStall).div_ceil(2);
        let encoder_looks = looks(q, Param::TripEncoder).div_ceil(2);
        self.encoder_looks = if q.is_on(Param::WindingTime) { encoder_looks << 3 } else { encoder_looks };
        self.lines_looks = lines_looks;
        self.runaway_looks = looks(q, Param::TripRunaway).div_ceil(2);
        self.supply_low = supply_bits(q, Param::TripSupplyLow);
        self.supply_high = supply_bits(q, Param::TripSupplyHigh);
        self.host_looks = looks(q, Param::TripHost);
        self.hung_looks = hung_looks;
        self.stop_mask = if q.is_on(Param::EmergencyStop) { Inputs::STOP_CLOSED } else { 0 };
        self.stop_released = if q.is(Param::EmergencyStop, NORMALLY_CLOSED) { Inputs::STOP_CLOSED } else { 0 };
    }

    /// The same, on its own.
    ///
    /// # Errors
    /// The first setting its format cannot hold, named.
    pub fn build(settings: &Settings) -> Result<Self, BuildError> {
        Quantiser::build_in_place(settings, Self::quantise)
    }
}

/// Tick over thermal time, times 2^24.
fn heat_rate(q: &mut Quantiser) -> u16 {
    q.of(1.0 / 256.0).times(Param::TickRate).times(Param::TripThermalTime).one_over(Param::TripThermalTime, 0.0)
}

/// A time in looks; the shortest is one.
#[inline(never)]
#[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
fn looks(q: &mut Quantiser, param: Param) -> u16 {
    (q.bits(param) as u16).saturating_add(TURNS as u16 - 1) / TURNS as u16
}

/// A limit of the supply; one beyond the format is never reached.
#[inline(never)]
#[cfg_attr(target_arch = "avr", unsafe(link_section = ".lowtext.quantise"))]
fn supply_bits(q: &mut Quantiser, param: Param) -> i16 {
    q.of(VOLT).times(param).saturate(param, i16::MAX as u16) as i16
}

/// What the trips look at, in bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Observation {
    /// Voltage of the tick before.
    pub voltage: i16,
    /// Measured current.
    pub current: i16,
    /// Measured speed, without the filter.
    pub speed: i16,
    /// Supply, where it is measured.
    pub supply: Option<i16>,
    /// What the encoder's edges say.
    pub edges: Proof,
    /// Ticks, modulo 256: whose turn it is to be looked at.
    pub turn: u8,
    /// The current signal is at a rail.
    pub sensor_at_rail: bool,
    /// As in [`Inputs::flags`].
    pub flags: u8,
}

/// Counters of how long each condition has held.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct TripsState {
    /// Low-passed square of the current, times 2^16.
    heat: i32,
    /// Back-EMF, less a quarter of the voltage, that the voltage implied when it was last looked at.
    implied: i16,
    /// Negative where the voltage was.
    direction: i8,
    /// Negative once the voltage has changed its direction since: then it drives the current first, and implies nothing until
    /// that has settled. Nor is it braking any more.
    reversed: i8,
    /// The last square that was taken, in bits of current squared over 2^15.
    squared: i16,
    still: u16,
    /// Looks in which the voltage implied a speed that was not measured, less those in which it did not.
    implausible: u16,
    against: u16,
    against_speed: i16,
    host: u16,
    peak: u8,
    rail: u8,
    supply: u8,
    hung: u8,
    /// Looks without motion; stays at the largest.
    quiet: u8,
    /// Looks with edges to and fro in a row.
    to_and_fro: u8,
    /// Illegal transitions, less one for each look without any.
    illegal: u8,
    illegal_before: u8,
    place: u8,
    /// Since the last look at them.
    flags: u8,
}

/// Looks, in every other tick, in which the current signal may touch a rail.
const RAIL_LOOKS: u8 = 2;
/// What need not come at once is looked at by turns.
const TURNS: u8 = 4;
/// Looks at the encoder's lines for one at whether the shaft is held.
const LOOKS_A_ROUND: u8 = 2;
/// 10 ms, at 2 kHz 6 ms.
const SUPPLY_LOOKS: u8 = 3;
/// What a bridge of bipolar transistors may take, with some reserve: 3 V.
const LARGEST_DROP: i16 = 3 * VOLT as i16;
/// The setting `emergency_stop` of a contact that opens when it is pressed.
const NORMALLY_CLOSED: f32 = 2.0;
/// An encoder that has not moved for so many looks is silent, else it counts too few.
const SILENT: u8 = 3;
/// So many illegal transitions trip; a look without any takes one away. Sound lines have none at all.
const ILLEGAL_MOST: u8 = 16;
/// Fewer are no sign of a broken line.
const ILLEGAL_SIGN: u8 = 2;
/// Edges to and fro in so many looks are none of a motor that turns.
const TO_AND_FRO_SIGN: u8 = 3;
/// A motor that turns and is measured moves by three counts within so many looks, unless it creeps.
const QUIET: u8 = 5;

impl TripsState {
    /// Whether the main loop has been silent for its time as of the last tick, whatever else has tripped.
    #[inline(always)]
    pub fn main_loop_hung(&self, config: &TripsConfig) -> bool {
        self.hung >= config.hung_looks
    }

    /// One tick: the first condition that has held for its time, or [`Trip::None`]. What must come at once is looked at in
    /// every tick, the rest by turns, each in every fourth or eighth.
    #[inline(always)]
    pub fn step(&mut self, config: &TripsConfig, seen: &Observation, armed: bool) -> Trip {
        let current = magnitude(seen.current);
        self.flags |= seen.flags;
        let urgent = self.urgent(config, seen, current, armed);
        let turn = seen.turn % (2 * TURNS);
        let trip = if turn.is_multiple_of(2) {
            self.every_other_tick(config, seen, armed, turn)
        } else {
            match turn {
                1 => self.imply(config, seen, current, armed),
                3 => self.held(config, seen, current, armed),
                5 => self.motion(config, seen),
                _ => self.heat_up(config),
            }
        };
        if urgent != Trip::None { urgent } else { trip }
    }

    /// The emergency stop, what destroys the bridge, and the sensor that would see it.
    #[inline(always)]
    fn urgent(&mut self, config: &TripsConfig, seen: &Observation, current: i16, armed: bool) -> Trip {
        if seen.flags & config.stop_mask ^ config.stop_released != 0 {
            return Trip::EmergencyStop;
        }
        // No current flows through a bridge that is off.
        let peak = for_ticks(&mut self.peak, current > config.peak, config.peak_ticks);
        if peak && armed {
            return Trip::OverCurrentPeak;
        }
        if peak { Trip::SensorRange } else { Trip::None }
    }

    /// The direction of the voltage, the rails of the current sensor; and by turns what may wait.
    #[inline(always)]
    fn every_other_tick(&mut self, config: &TripsConfig, seen: &Observation, armed: bool, turn: u8) -> Trip {
        self.reversed |= (seen.voltage >> 8) as i8 ^ self.direction;
        let railed = for_ticks(&mut self.rail, seen.sensor_at_rail, RAIL_LOOKS);
        let trip =
            if turn.is_multiple_of(TURNS) { self.lines(config, seen, armed) } else { self.board(config, seen, armed) };
        if railed { Trip::SensorRange } else { trip }
    }

    /// Main loop, stack, converter, host and supply.
    #[inline(always)]
    fn board(&mut self, config: &TripsConfig, seen: &Observation, armed: bool) -> Trip {
        let flags = core::mem::take(&mut self.flags);
        // Before all that may return: a hang must be noticed beside any other trip, or the watchdog is fed for ever.
        if for_ticks(&mut self.hung, flags & Inputs::MAIN_LOOP_ALIVE == 0, config.hung_looks) {
            return Trip::MainLoopHung;
        }
        if flags & Inputs::STACK_OVERFLOW != 0 {
            return Trip::StackOverflow;
        }
        if flags & Inputs::NOT_CONVERTED != 0 {
            return Trip::ConverterSilent;
        }
        if !armed || flags & Inputs::HOST_SPOKE != 0 {
            self.host = 0;
        }
        if armed && for_looks(&mut self.host, config.host_looks) {
            return Trip::HostLost;
        }
        let outside = seen.supply.is_some_and(|supply| supply < config.supply_low || supply > config.supply_high);
        if for_ticks(&mut self.supply, outside, SUPPLY_LOOKS) { Trip::SupplyRange } else { Trip::None }
    }

    /// Edges without motion, or both lines at once; and whether the motor is hot.
    #[inline(always)]
    fn lines(&mut self, config: &TripsConfig, seen: &Observation, armed: bool) -> Trip {
        if (self.heat >> 16) as i16 > config.heat_limit {
            return Trip::OverCurrentThermal;
        }
        let edges = seen.edges;
        let mut broken = false;
        if edges.place != self.place {
            self.place = edges.place;
            self.quiet = 0;
            self.to_and_fro = 0;
        } else {
            if self.quiet < QUIET {
                self.quiet += 1;
            }
            broken = for_ticks(&mut self.to_and_fro, edges.came && armed, config.lines_looks);
        }
        let illegal = edges.illegal.wrapping_sub(self.illegal_before);
        if illegal != 0 {
            self.illegal_before = edges.illegal;
            self.illegal = self.illegal.saturating_add(illegal);
        } else if self.illegal != 0 {
            self.illegal -= 1;
        }
        if self.illegal >= ILLEGAL_MOST {
            broken = armed;
            self.illegal = ILLEGAL_MOST;
        }
        if broken { Trip::EncoderLines } else { Trip::None }
    }

    /// The speed that the voltage implies, as the back-EMF that it must have.
    #[inline(always)]
    fn imply(&mut self, config: &TripsConfig, seen: &Observation, current: i16, armed: bool) -> Trip {
        let drive = magnitude(seen.voltage);
        self.implied = NOTHING;
        let direction = (seen.voltage >> 8) as i8;
        let reversed = core::mem::take(&mut self.reversed) | direction ^ self.direction;
        self.direction = direction;
        if reversed < 0 {
            self.against = 0;
        } else if armed && drive >= config.known_from {
            self.implied = saturating_sub_i16(drive - (drive >> 2), scaled(current, config.resistive));
        }
        Trip::None
    }

    /// Whether the shaft turns as fast as has been implied four ticks ago.
    #[inline(always)]
    fn motion(&mut self, config: &TripsConfig, seen: &Observation) -> Trip {
        let along = along(self.direction < 0, seen.speed);
        if self.reversed < 0 {
            self.implied = NOTHING;
        }
        let known = config.back_emf != 0 || self.quiet >= QUIET || along < STILL;
        let missing = saturating_sub_i16(self.implied, scaled(along, config.back_emf));
        if !known || missing <= config.turning {
            if self.implausible != 0 {
                self.implausible -= 1;
            }
            Trip::None
        } else if for_looks(&mut self.implausible, config.encoder_looks) {
            self.name(along)
        } else {
            Trip::None
        }
    }

    /// Takes the square of the current; whether the shaft is held, or turns against the voltage.
    #[inline(always)]
    fn held(&mut self, config: &TripsConfig, seen: &Observation, current: i16, armed: bool) -> Trip {
        self.squared = (mul_i16(current, current) << 1 >> 16) as i16;
        if !armed || magnitude(seen.voltage) < config.driven {
            self.still = 0;
            self.against = 0;
            return Trip::None;
        }
        if self.turns_against(config, along(seen.voltage < 0, seen.speed)) {
            return Trip::Runaway;
        }
        if self.quiet < LOOKS_A_ROUND {
            self.still = 0;
        }
        // A blocked motor draws its stall current.
        let stalled = current > config.continuous && for_looks(&mut self.still, config.stall_looks);
        if stalled { Trip::Stall } else { Trip::None }
    }

    /// What a speed that is not measured comes of.
    #[inline(never)]
    fn name(&self, along: i16) -> Trip {
        if self.illegal >= ILLEGAL_SIGN || self.to_and_fro >= TO_AND_FRO_SIGN {
            Trip::EncoderLines
        } else if self.quiet >= SILENT {
            Trip::EncoderSilent
        } else if along < STILL {
            Trip::Runaway
        } else {
            Trip::EncoderTooFew
        }
    }

    /// Speed against the voltage is braking as long as it falls; when it does not, the feedback has the wrong sign.
    #[inline(always)]
    fn turns_against(&mut self, config: &TripsConfig, along: i16) -> bool {
        let speed = magnitude(along);
        // A speed that is timed by edges fades slowly on a shaft that rests.
        if along >= STILL || self.quiet >= QUIET {
            self.against = 0;
        } else if self.against == 0 || speed < saturating_sub_i16(self.against_speed, FALLING) {
            self.against = 1;
            self.against_speed = speed;
        } else {
            return for_looks(&mut self.against, config.runaway_looks);
        }
        false
    }

    /// Low-pass of the squared current. Both are below 2^15, so nothing here can leave 32 bits.
    #[inline(always)]
    fn heat_up(&mut self, config: &TripsConfig) -> Trip {
        let difference = self.squared - (self.heat >> 16) as i16;
        self.heat += mul_i16_u16(difference, config.heat_rate) >> 8 << 3;
        Trip::None
    }
}

/// Bits of speed (2^-8 of the range) by which a braked motor must have slowed down to count as slowing.
const FALLING: i16 = 128;

/// Implied by a voltage that drives nothing: less than any speed takes away.
const NOTHING: i16 = i16::MIN;
/// A speed of zero, seen from a negative voltage.
const STILL: i16 = !0;

/// The measured speed, positive along the voltage; one bit less from a negative one.
#[inline(always)]
fn along(backward: bool, speed: i16) -> i16 {
    if backward { !speed } else { speed }
}

/// A product in bits of voltage, saturating.
#[inline(always)]
fn scaled(value: i16, factor: u16) -> i16 {
    saturate_shift_8(mul_i16_u16(value, factor))
}

/// The magnitude; of a negative number one bit less, so that all have one in 16 bits.
#[inline(always)]
fn magnitude(value: i16) -> i16 {
    if value < 0 { !value } else { value }
}

/// One look more; whether that makes it so many, of which none is for ever.
#[inline(always)]
fn for_looks(counter: &mut u16, looks: u16) -> bool {
    if *counter < looks {
        *counter += 1;
    }
    looks != 0 && *counter >= looks
}

/// Whether `condition` has now held for `ticks` in a row.
#[inline(always)]
fn for_ticks(counter: &mut u8, condition: bool, ticks: u8) -> bool {
    if !condition {
        *counter = 0;
        return false;
    }
    if *counter < ticks {
        *counter += 1;
    }
    *counter >= ticks
}

#[cfg(test)]
mod tests;
