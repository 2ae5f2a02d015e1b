//! The control loop on its own, on the host.

use motorbench_core::control_loop::{ControlLoop, Drive, Inputs, LoopConfig, duty_scale};
use motorbench_core::encoder::Edges;
use motorbench_core::message::{Mode, Request, Trip};
use motorbench_core::settings::{Param, Settings};

/// Inputs of a quiet tick: no motion, no current.
fn quiet() -> Inputs {
    Inputs {
        current_sum: 4096,
        duty_scale: duty_scale(12_288),
        flags: Inputs::MAIN_LOOP_ALIVE | Inputs::HOST_SPOKE,
        ..Inputs::default()
    }
}

/// Armed, in a mode, at a reference.
fn driven(values: &[(Param, f32)], mode: Mode, reference: i32) -> ControlLoop {
    let mut settings = Settings::defaults();
    for &(param, value) in values {
        settings.set(param, value).unwrap();
    }
    let mut control = ControlLoop::new(LoopConfig::build(&settings).unwrap(), Edges::default());
    for request in [Request::Arm, Request::Mode(mode), Request::Reference(reference)] {
        control.tick(Some(request), &quiet());
    }
    control
}

/// The voltage limit leaves the controller nothing: the drive must rest, not be thrown to and fro each tick.
#[test]
fn a_drop_above_the_voltage_limit_does_not_chatter() {
    for (limit, drop) in [(2.0, 8.0), (0.0, 1.0), (3.0, 3.0)] {
        for mode in [Mode::SpeedPid, Mode::PositionPid, Mode::SpeedLqr, Mode::PositionLqr] {
            let mut control = driven(&[(Param::VoltageLimit, limit), (Param::CompDrop, drop)], mode, 2000);
            let duties: Vec<i16> =
                (0..300).map(|_| control.tick(None, &quiet())).map(|drive: Drive| drive.duty).collect();
            let turns = duties.windows(2).filter(|pair| pair[0].signum() * pair[1].signum() < 0).count();
            assert!(turns == 0, "{mode:?} {limit} {drop}: {turns} turns, {duties:?}");
        }
    }
}

/// A tachogenerator's offset is no motion: a blocked or a silent drive trips all the same.
#[test]
fn a_tachogenerator_near_zero_does_not_hide_a_stall() {
    // 0.7 A at 185 mV/A, above the continuous rating.
    for (tacho, current_sum, expected) in [
        (1, 4096 + 212, Trip::Stall),
        (4, 4096 + 212, Trip::Stall),
        (1, 4096, Trip::EncoderSilent),
        (5, 4096 + 212, Trip::None),
    ] {
        let mut control = driven(&[(Param::SpeedSensor, 1.0)], Mode::OpenLoop, 6 * 1024);
        (0..700).for_each(|_| {
            control.tick(None, &Inputs { tacho, current_sum, ..quiet() });
        });
        assert_eq!(control.sample().trip, expected, "{tacho} {current_sum}");
    }
}
