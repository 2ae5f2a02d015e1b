//! Each trip comes in its time, and what is normal does not trip.

use super::*;
use crate::units::AMPERE;
use proptest::prelude::*;

/// In [`trips_after`] the place changes with each tick.
const MOVES: Proof = Proof { came: true, place: 255, illegal: 0 };
const RESTS: Proof = Proof { came: false, place: 0, illegal: 0 };
const TO_AND_FRO: Proof = Proof { came: true, place: 0, illegal: 0 };

/// As it is seen in a tick.
fn at(tick: u32, mut seen: Observation) -> Observation {
    seen.turn = tick as u8;
    if seen.edges.place == MOVES.place {
        seen.edges.place = (tick % 250) as u8;
    }
    seen
}

/// A motor that turns quietly.
fn healthy() -> Observation {
    Observation {
        voltage: 6144,
        current: 400,
        speed: 6000,
        edges: MOVES,
        flags: Inputs::MAIN_LOOP_ALIVE | Inputs::HOST_SPOKE,
        ..Observation::default()
    }
}

/// Ticks until the trip that `observation` brings, or none within ten seconds.
fn trips_after(settings: &Settings, observation: impl Fn(u32) -> Observation) -> Option<(Trip, u32)> {
    let config = TripsConfig::build(settings).unwrap();
    let mut state = TripsState::default();
    (0..10_000).find_map(|tick| match state.step(&config, &at(tick, observation(tick)), true) {
        Trip::None => None,
        trip => Some((trip, tick + 1)),
    })
}

/// With the back-EMF of the default motor known.
fn known() -> Settings {
    let mut settings = Settings::defaults();
    settings.set(Param::TorqueConstant, 0.072).unwrap();
    settings
}

fn with(values: &[(Param, f32)]) -> Settings {
    let mut settings = known();
    for &(param, value) in values {
        settings.set(param, value).unwrap();
    }
    settings
}

/// A motor under a binary sequence of 6 V either way, each bit so many ticks long: what identifies it best.
fn driven_by_bits(bit_ticks: u32, first: u32) -> impl Fn(u32) -> Observation {
    const STEPS: u32 = 20;
    let (mut register, mut current, mut speed) = (0xace1_u16, 0.0_f64, 0.0_f64);
    let rows: Vec<Observation> = (0..10_000)
        .map(|tick| {
            if (tick + first).is_multiple_of(bit_ticks) {
                let bit = (register ^ register >> 2 ^ register >> 3 ^ register >> 5) & 1;
                register = register >> 1 | bit << 15;
            }
            let volts = if register & 1 != 0 { 6.0 } else { -6.0 };
            let seen = Observation {
                voltage: (volts * VOLT) as i16,
                current: (current * f64::from(AMPERE)) as i16,
                speed: (speed * f64::from(FULL_RANGE) / 512.0) as i16,
                ..healthy()
            };
            for _ in 0..STEPS {
                let step_s = 1e-3 / f64::from(STEPS);
                current += step_s * (f64::from(volts) - 5.84 * current - 0.072 * speed) / 11.68e-3;
                speed += step_s * (0.072 * current - 5e-6 * speed) / 2.22e-5;
            }
            seen
        })
        .collect();
    move |tick| rows[tick as usize]
}

#[test]
fn a_healthy_motor_runs_on() {
    assert_eq!(trips_after(&known(), |_| healthy()), None);
    assert_eq!(trips_after(&Settings::defaults(), |_| healthy()), None);
}

#[test]
fn each_trip_comes_in_its_time() {
    let amps = |a: f32| (a * AMPERE) as i16;
    let known = known();
    // Within the eight ticks of a round of looks.
    let check = |name: &str, (trip, ticks): (Trip, u32), found: Option<(Trip, u32)>| {
        let (found, after) = found.unwrap_or_else(|| panic!("{name}: no trip"));
        assert_eq!(found, trip, "{name}");
        assert!((ticks.saturating_sub(3)..=ticks + 8).contains(&after), "{name}: {after} ticks instead of {ticks}");
    };
    let one = |observation: Observation| trips_after(&known, move |_| observation);
    let peak = one(Observation { current: amps(-1.3), ..healthy() });
    check("peak", (Trip::OverCurrentPeak, 5), peak);
    let stall = one(Observation { current: amps(0.7), speed: 0, edges: RESTS, ..healthy() });
    check("stall", (Trip::Stall, 500), stall);
    let silent = one(Observation { speed: 0, edges: RESTS, current: amps(0.2), ..healthy() });
    check("silent", (Trip::EncoderSilent, 20), silent);
    // Too much current to say what speed the voltage implies; then little.
    let against =
        |current| move |tick: u32| Observation { speed: -1000 - tick as i16, current: amps(current), ..healthy() };
    check("runaway", (Trip::Runaway, 100), trips_after(&known, against(1.1)));
    check("runaway, implied", (Trip::Runaway, 20), trips_after(&known, against(0.1)));
    // 6 V, 0.1 A, and 8 rad/s instead of 70.
    let too_few = one(Observation { speed: 500, current: amps(0.1), ..healthy() });
    check("too few", (Trip::EncoderTooFew, 20), too_few);
    // Without the back-EMF nobody knows; that it turns is enough.
    let unknown = with(&[(Param::TorqueConstant, 0.0)]);
    let slow = trips_after(&unknown, |_| Observation { speed: 500, current: amps(0.1), ..healthy() });
    assert_eq!(slow, None);
    let still = trips_after(&unknown, |_| Observation { speed: 0, edges: RESTS, ..healthy() });
    check("silent, back-EMF not known", (Trip::EncoderSilent, 38), still);
    let to_and_fro = one(Observation { voltage: 500, speed: 0, edges: TO_AND_FRO, ..healthy() });
    check("to and fro", (Trip::EncoderLines, 64), to_and_fro);
    check(
        "illegal",
        (Trip::EncoderLines, 8),
        trips_after(&known, |tick| {
            let edges = Proof { illegal: (2 * tick) as u8, ..MOVES };
            Observation { edges, ..healthy() }
        }),
    );
    let dead = one(Observation { flags: healthy().flags | Inputs::NOT_CONVERTED, ..healthy() });
    check("converter", (Trip::ConverterSilent, 2), dead);
    let overflow = one(Observation { flags: healthy().flags | Inputs::STACK_OVERFLOW, ..healthy() });
    check("stack", (Trip::StackOverflow, 2), overflow);
    check("sensor", (Trip::SensorRange, 4), one(Observation { sensor_at_rail: true, ..healthy() }));
    let supply = one(Observation { supply: Some((4.0 * VOLT) as i16), ..healthy() });
    check("supply", (Trip::SupplyRange, 10), supply);
    check(
        "stop",
        (Trip::EmergencyStop, 1),
        one(Observation { flags: healthy().flags | Inputs::STOP_CLOSED, ..healthy() }),
    );
    check("hung", (Trip::MainLoopHung, 100), one(Observation { flags: Inputs::HOST_SPOKE, ..healthy() }));
    let host = with(&[(Param::TripHost, 250.0)]);
    let lost = trips_after(&host, |_| Observation { flags: Inputs::MAIN_LOOP_ALIVE, ..healthy() });
    check("host", (Trip::HostLost, 250), lost);
}

/// With the drive disarmed no current flows: what shows one is the sensor.
#[test]
fn a_current_without_a_drive_is_the_sensors() {
    let config = TripsConfig::build(&known()).unwrap();
    let mut state = TripsState::default();
    let seen = Observation { current: i16::MIN, voltage: 0, ..healthy() };
    let trip = (0..10).map(|_| state.step(&config, &seen, false)).find(|trip| *trip != Trip::None);
    assert_eq!(trip, Some(Trip::SensorRange));
}

/// A wire that breaks opens the contact: that stops where it is normally closed. Without a stop nothing is looked at.
#[test]
fn the_emergency_stop_is_of_the_kind_that_is_set() {
    for (kind, closed, stops) in
        [(0, false, false), (0, true, false), (1, false, false), (1, true, true), (2, false, true), (2, true, false)]
    {
        let settings = with(&[(Param::EmergencyStop, kind as f32)]);
        let flags = healthy().flags | if closed { Inputs::STOP_CLOSED } else { 0 };
        let found = trips_after(&settings, |_| Observation { flags, ..healthy() });
        assert_eq!(found, stops.then_some((Trip::EmergencyStop, 1)), "{kind} {closed}");
    }
}

/// Whatever else has tripped, and armed or not: the watchdog must know of a hang.
#[test]
fn a_hang_is_noticed_beside_any_other_trip() {
    let config = TripsConfig::build(&known()).unwrap();
    for armed in [true, false] {
        let mut state = TripsState::default();
        let stopped = |flags| Observation { sensor_at_rail: true, flags, ..healthy() };
        for tick in 0..304 {
            assert!(!state.main_loop_hung(&config), "{tick}");
            let flags = Inputs::STOP_CLOSED | Inputs::MAIN_LOOP_ALIVE;
            assert_eq!(state.step(&config, &at(tick, stopped(flags)), armed), Trip::EmergencyStop);
        }
        let hung = (1..300).find(|&tick| {
            state.step(&config, &at(tick, stopped(Inputs::STOP_CLOSED)), armed);
            state.main_loop_hung(&config)
        });
        assert!(hung.is_some_and(|tick| (97..=104).contains(&tick)), "{hung:?}");
    }
}

#[test]
fn what_is_normal_does_not_trip() {
    let amps = |a: f32| (a * AMPERE) as i16;
    let quiet = |observation: Observation| {
        assert_eq!(trips_after(&known(), move |_| observation), None, "{observation:?}");
    };
    // Resting in its friction at 1 V; holding against a load with stall current below the continuous rating.
    quiet(Observation { voltage: 1000, speed: 0, edges: RESTS, current: amps(0.17), ..healthy() });
    quiet(Observation { voltage: 3000, speed: 0, edges: RESTS, current: amps(0.5), ..healthy() });
    // Nobody asked for a host.
    quiet(Observation { flags: Inputs::MAIN_LOOP_ALIVE, ..healthy() });
    // Braking by reverse voltage: 300 ms from 60 rad/s to rest, again and again; 2.6 V are the bridge's.
    let braking = |tick: u32| {
        let speed = 3840 - (tick % 300) as i16 * 12;
        let back_emf_v = 0.072 * 512.0 * f32::from(speed) / FULL_RANGE;
        let current = amps((-3.125 - back_emf_v + 2.6) / 5.84);
        Observation { voltage: if tick % 300 < 290 { -3200 } else { 3200 }, speed, current, ..healthy() }
    };
    assert_eq!(trips_after(&known(), braking), None);
    // One tick at the rail, five milliseconds of peak less one tick.
    let spike = |tick: u32| Observation {
        sensor_at_rail: tick % 10 < 2,
        current: if tick % 100 < 4 { amps(2.0) } else { 100 },
        ..healthy()
    };
    assert_eq!(trips_after(&known(), spike), None);
    // Held by its friction under either voltage.
    for voltage in [-4200, 4200] {
        quiet(Observation { voltage, speed: 0, edges: RESTS, current: amps(0.27), ..healthy() });
    }
    // A count that dithers by one, 200 times a second, at any voltage that a held shaft may need.
    let dither = |tick: u32| {
        let edges = if tick.is_multiple_of(5) { TO_AND_FRO } else { RESTS };
        Observation { voltage: 5120, speed: 0, current: amps(0.43), edges, ..healthy() }
    };
    assert_eq!(trips_after(&known(), dither), None);
    // At rest under 3.2 V, with what is left of the speed that it had the other way.
    quiet(Observation { voltage: 3300, speed: -2, edges: RESTS, current: amps(0.13), ..healthy() });
    // Creeping at 1 rpm: three counts in 90 ms.
    let creep = |tick: u32| {
        let came = tick.is_multiple_of(30);
        let edges = Proof { came, place: (tick / 90 % 250) as u8, illegal: 0 };
        Observation { voltage: 5120, speed: 7, current: amps(0.43), edges, ..healthy() }
    };
    assert_eq!(trips_after(&known(), creep), None);
    let large = [(Param::TripPeak, 5.0), (Param::TripContinuous, 3.0)];
    for settings in [with(&large), with(&[large[0], large[1], (Param::TorqueConstant, 0.0)])] {
        for bit_ticks in [1, 2, 3, 4, 5, 8, 10, 12, 16, 20, 24, 50] {
            for first in 0..8 {
                assert_eq!(trips_after(&settings, driven_by_bits(bit_ticks, first)), None, "{bit_ticks} {first}");
            }
        }
    }
    // Turned back by a load, against 6 V: the current is larger than that of a held shaft.
    let driven_back = |_| Observation { speed: -300, current: amps(0.66), ..healthy() };
    assert_eq!(trips_after(&with(&[(Param::TripRunaway, 0.0), (Param::TripContinuous, 1.0)]), driven_back), None);
}

proptest! {
    /// The thermal trip follows the low-passed square in real numbers: within 3 % of its time.
    #[test]
    fn thermal_trip_time(current in 0.63f64..1.15, time in 0.5f32..4.0) {
        let settings = with(&[(Param::TripThermalTime, time)]);
        let bits = (current * AMPERE as f64) as i16;
        let found = trips_after(&settings, |_| Observation { current: bits, ..healthy() });
        // 1 - exp(-t/T) = (limit / current)^2
        let exact = -(time as f64) * (1.0 - (0.6 / current).powi(2)).ln() * 1000.0;
        prop_assume!(exact < 9_000.0);
        let (trip, ticks) = found.unwrap();
        prop_assert_eq!(trip, Trip::OverCurrentThermal);
        // Near the limit a bit of current squared weighs much: the limit itself is held to 1 %.
        let low = -(time as f64) * (1.0 - (0.594 / current).powi(2)).ln() * 970.0;
        let high = -(time as f64) * (1.0 - (0.606 / current).powi(2)).ln() * 1030.0;
        prop_assert!((low..=high).contains(&(ticks as f64)), "{ticks} for {exact}");
    }

    /// Whatever is seen, nothing overflows, and nothing but a trip is returned.
    #[test]
    fn anything_goes(values in proptest::collection::vec(any::<(i16, i16, i16, u8)>(), 1..300)) {
        let config = TripsConfig::build(&known()).unwrap();
        let mut state = TripsState::default();
        for (tick, (voltage, current, speed, flags)) in (0..=255u8).cycle().zip(values) {
            let supply = (flags & 1 != 0).then_some(voltage);
            let edges = if flags & 2 != 0 { MOVES } else { TO_AND_FRO };
            state.step(&config, &Observation { voltage, current, speed, supply, edges, turn: tick, flags: Inputs::MAIN_LOOP_ALIVE,
                ..Observation::default() }, flags & 4 != 0);
        }
    }
}
