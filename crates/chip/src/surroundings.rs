//! The motor and its sensors as the chip's world.
//!
//! Plant and chip share one time. The plant is advanced to each instant at which something happens between them, and at
//! least every other PWM period. That is a switching edge of the bridge, an edge of the encoder, a sample of the
//! converter, or a row of the recording. Encoder edges come at the cycle in which the angle passes the boundary. It is
//! predicted from the speed. If the plant is then on the near side, it is predicted anew.

use motorbench_board::pins::{CURRENT_SENSE, EMERGENCY_STOP, SUPPLY_SENSE, TACHOGENERATOR};
use motorbench_core::HARDWARE;

use super::encoder::Encoder;
use super::recorder::{Recording, Row};
use super::rig::Rig;
use super::sensors::{Noise, SensorFault};
use super::world::{Outputs, World};
use host_sim::plant::{Inputs, Plant};

/// Longest time for which the plant is left alone. While the PWM runs, its edges come more often than this.
const LONGEST_STEP_CYCLES: u64 = 2 * HARDWARE.pwm_steps as u64;

/// Everything outside the chip; [`super::Bench`] is its handle.
pub struct Surroundings<P> {
    pub(super) rig: Rig,
    pub(super) plant: P,
    pub(super) inputs: Inputs,
    pub(super) encoder: Encoder,
    pub(super) current_fault: Option<SensorFault>,
    pub(super) tacho_fault: Option<SensorFault>,
    pub(super) supply_fault: Option<SensorFault>,
    pub(super) stop_pressed: bool,
    pub(super) recording: Recording,
    outputs: Outputs,
    noise: Noise,
    /// Charge of the converter's sample-and-hold.
    held_v: f64,
    cycle: u64,
}

impl<P: Plant> Surroundings<P> {
    pub(super) fn new(rig: Rig, plant: P) -> Self {
        Self {
            rig,
            plant,
            inputs: Inputs { supply_v: rig.supply_v, ..Inputs::default() },
            encoder: Encoder::new(&rig),
            current_fault: None,
            tacho_fault: None,
            supply_fault: None,
            stop_pressed: false,
            recording: Recording::default(),
            outputs: Outputs::default(),
            noise: Noise::new(rig.seed),
            held_v: 0.0,
            cycle: 0,
        }
    }

    /// Brings plant, recording and encoder to `cycle`; instants that have passed are left alone.
    pub(super) fn advance_to(&mut self, cycle: u64) {
        while let Some(at) = self.recording.due(cycle) {
            self.advance_plant(at);
            let row = self.row();
            self.recording.push(row);
        }
        self.advance_plant(cycle);
        self.encoder.update(self.cycle, self.plant.angle_rad());
    }

    fn advance_plant(&mut self, cycle: u64) {
        if cycle > self.cycle {
            let dt_s = (cycle - self.cycle) as f64 / f64::from(HARDWARE.clock_hz);
            self.plant.advance(dt_s, &self.inputs);
            self.cycle = cycle;
        }
    }

    /// The truth now.
    pub(super) fn row(&self) -> Row {
        Row {
            cycle: self.cycle,
            t_s: self.cycle as f64 / f64::from(HARDWARE.clock_hz),
            bridge: self.inputs.bridge,
            duty: self.outputs.pwm.duty(),
            angle_rad: self.plant.angle_rad(),
            speed_rad_per_s: self.plant.speed_rad_per_s(),
            current_a: self.plant.current_a(),
            supply_v: self.plant.supply_v(),
            encoder_count: self.encoder.count(),
            port_d_inputs: self.port_d_inputs(),
        }
    }

    /// What the sensor at a channel would give, and its fault.
    fn sensor(&mut self, channel: u8) -> (f64, Option<SensorFault>) {
        let plant = &self.plant;
        if channel == CURRENT_SENSE.bit {
            (self.rig.current_sensor.output_v(plant.current_a(), self.noise.normal()), self.current_fault)
        } else if channel == TACHOGENERATOR.bit {
            let output_v = self.rig.tachogenerator.output_v(plant.speed_rad_per_s(), plant.angle_rad());
            (output_v, self.tacho_fault)
        } else if channel == SUPPLY_SENSE.bit {
            (self.rig.supply_divider.output_v(plant.supply_v()), self.supply_fault)
        } else {
            (0.0, Some(SensorFault::Open))
        }
    }
}

impl<P: Plant> World for Surroundings<P> {
    fn outputs_changed(&mut self, cycle: u64, outputs: &Outputs) {
        self.advance_to(cycle);
        self.outputs = *outputs;
        self.inputs.bridge = self.rig.wiring.bridge(outputs);
    }

    fn wake(&mut self, cycle: u64) {
        self.advance_to(cycle);
    }

    fn next_wake(&self) -> Option<u64> {
        let edge = self.encoder.next_edge(self.cycle, self.plant.angle_rad(), self.plant.speed_rad_per_s());
        let latest = self.cycle + LONGEST_STEP_CYCLES;
        Some(edge.map_or(latest, |at| at.min(latest)))
    }

    fn port_d_inputs(&self) -> u8 {
        self.encoder.lines() | if self.stop_pressed { 0 } else { EMERGENCY_STOP.mask() }
    }

    fn analog_in_v(&mut self, cycle: u64, channel: u8) -> f64 {
        self.advance_to(cycle);
        let (output_v, fault) = self.sensor(channel);
        self.held_v = match fault {
            None => output_v,
            Some(SensorFault::PinnedV(pinned_v)) => pinned_v,
            Some(SensorFault::Open) => self.held_v,
        };
        self.held_v
    }
}
