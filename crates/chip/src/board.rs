//! Puts the models together: which register, timer or interrupt goes to which of them.

use motorbench_board::pins::{EMERGENCY_STOP, ENCODER_A, ENCODER_B};

use super::adc::Adc;
use super::eeprom::Eeprom;
use super::ffi::{Cpu, Device, Interrupt, Port};
use super::flags;
use super::meter::{Meter, Sample};
use super::prescaler::Prescaler;
use super::pwm::Pwm;
use super::registers::*;
use super::usart::Usart;
use super::world::{Outputs, World};
use super::{BANDGAP_V, Crash};

/// Cycles from the acceptance of an interrupt to the first instruction at its vector (section 7.7.1).
const RESPONSE_CYCLES: u64 = 4;
/// Additional cycles if the processor slept.
const WAKE_CYCLES: u64 = 4;
/// Pins of port D that the world may drive.
const INPUT_PINS: u8 = ENCODER_A.mask() | ENCODER_B.mask() | EMERGENCY_STOP.mask();

/// Numbers of the cycle timers.
mod timer {
    pub const PWM: u8 = 0;
    pub const WORLD: u8 = 1;
    pub const ADC: u8 = 2;
    pub const SEND: u8 = 3;
    pub const RECEIVE: u8 = 4;
    pub const EEPROM: u8 = 5;
}

/// The Rust side of the chip, with the world around it.
pub(super) struct Board<W> {
    pub world: W,
    pub usart: Usart,
    pub eeprom: Eeprom,
    pub meter: Meter,
    pub crash: Option<Crash>,
    pub outputs: Outputs,
    pwm: Pwm,
    prescaler: Prescaler,
    pub adc: Adc,
    /// Levels that the input pins have now.
    inputs: u8,
    wake_at: Option<u64>,
}

impl<W: World> Board<W> {
    pub fn new(world: W) -> Self {
        Self {
            world,
            usart: Usart::new(),
            eeprom: Eeprom::new(),
            meter: Meter::default(),
            crash: None,
            outputs: Outputs::default(),
            pwm: Pwm::default(),
            prescaler: Prescaler::default(),
            adc: Adc::default(),
            inputs: 0,
            wake_at: None,
        }
    }

    /// Brings the world's pins to the chip and asks when it wants to be called again.
    pub fn attend(&mut self, cpu: &Cpu) {
        self.show_inputs(cpu);
        self.plan_wake(cpu);
    }

    fn show_inputs(&mut self, cpu: &Cpu) {
        let levels = self.world.port_d_inputs() & INPUT_PINS;
        let changed = levels ^ self.inputs;
        if changed != 0 {
            self.inputs = levels;
            let pins = [ENCODER_A.bit, ENCODER_B.bit, EMERGENCY_STOP.bit];
            // Both lines have their new levels before the program can see either: it reads the port, not the edges.
            cpu.write(PIND, (cpu.read(PIND) & !INPUT_PINS) | levels);
            pins.into_iter().filter(|bit| changed & (1 << bit) != 0).for_each(|bit| {
                cpu.drive_port_d(bit, levels & (1 << bit) != 0);
            });
            flags::forget_levels(cpu);
        }
    }

    /// Sets the world's timer. An earlier setting stays: the world is then woken early and asked again, which costs less
    /// than moving the timer with every change of plan.
    fn plan_wake(&mut self, cpu: &Cpu) {
        let Some(wake_at) = self.world.next_wake() else { return };
        if self.wake_at.is_none_or(|earlier| wake_at < earlier) {
            self.wake_at = Some(wake_at);
            cpu.schedule(timer::WORLD, wake_at);
        }
    }

    /// Tells the world about outputs that have changed.
    fn show_outputs(&mut self, cpu: &Cpu, cycle: u64) {
        let shown = Outputs { oc1a: self.pwm.level(cycle), pwm: self.pwm.setting(), ..self.outputs };
        if shown != self.outputs {
            self.outputs = shown;
            self.world.outputs_changed(cycle, &shown);
            self.attend(cpu);
        }
    }

    fn pwm_due(&mut self, cpu: &Cpu, when: u64) -> Option<u64> {
        self.pwm.advance(cpu, when);
        self.show_outputs(cpu, when);
        self.pwm.next_event(when)
    }

    fn adc_due(&mut self, cpu: &Cpu, when: u64) -> Option<u64> {
        match self.adc.sampling() {
            Some(channel) => {
                let input_v = self.analog_in_v(when, channel);
                self.attend(cpu);
                self.meter.sampled(Sample { cycle: when, channel, input_v });
                self.adc.sample(input_v)
            }
            None => self.adc.done(cpu, when),
        }
    }

    /// The world's timer is due. What `attend` plans here comes back as the timer's next instant.
    fn world_due(&mut self, cpu: &Cpu, when: u64) -> Option<u64> {
        self.wake_at = None;
        self.world.wake(when);
        self.show_inputs(cpu);
        self.wake_at = self.world.next_wake();
        self.wake_at
    }

    fn analog_in_v(&mut self, cycle: u64, channel: u8) -> f64 {
        match channel {
            0..=7 => self.world.analog_in_v(cycle, channel),
            14 => BANDGAP_V,
            _ => 0.0,
        }
    }

    /// Lets the host's next byte start if the line is free.
    pub fn start_sending(&mut self, cpu: &Cpu) {
        let next = self.usart.host_sends(cpu.now());
        self.schedule(cpu, timer::RECEIVE, next);
    }

    pub fn set_transmitter_stuck(&mut self, cpu: &Cpu, stuck: bool) {
        let done = self.usart.set_stuck(cpu, stuck);
        self.schedule(cpu, timer::SEND, done);
    }

    fn schedule(&self, cpu: &Cpu, timer: u8, at: Option<u64>) {
        if let Some(at) = at {
            cpu.schedule(timer, at);
        }
    }
}

impl<W: World> Device for Board<W> {
    const WRITES: &'static [u16] = &[
        GTCCR, OCR2A, OCR2B, TCNT0, TCNT2, EIFR, EIMSK, EECR, TIMSK0, TIMSK1, TIMSK2, ADCSRA, ADCSRB, TCCR1A, TCCR1B,
        OCR1AL, OCR1BL, UCSR0A, UCSR0B, UCSR0C, UBRR0L, UDR0,
    ];
    const READS: &'static [u16] = &[EECR, ADCL, ADCH, UCSR0A, UDR0];
    const BITS: &'static [u16] = &[TIFR0, TIFR1, TIFR2, EIFR];
    const FLAGS: &'static [u8] =
        &[vector::TIMER1_CAPT, vector::TIMER1_COMPB, vector::TIMER1_OVF, vector::TIMER0_COMPA, vector::TIMER0_OVF];

    fn io_write(&mut self, cpu: &Cpu, address: u16, value: u8) {
        if self.meter.marker_register == Some(address) {
            self.meter.marked(cpu.now(), value);
        }
        match address {
            EIFR => (0..8).filter(|bit| value & (1 << bit) != 0).for_each(|bit| self.bit_set(cpu, EIFR, bit)),
            EECR => {
                let done = self.eeprom.control_written(cpu, value);
                self.schedule(cpu, timer::EEPROM, done);
            }
            ADCSRA => {
                let sample = self.adc.control_written(cpu, value);
                self.schedule(cpu, timer::ADC, sample);
            }
            OCR1AL => self.pwm.compare_written(cpu, value),
            OCR1BL => self.pwm.compare_b_written(cpu, value),
            TCCR1A | TCCR1B => {
                self.pwm.control_written(cpu, address, value);
                let next = self.pwm_due(cpu, cpu.now());
                self.schedule(cpu, timer::PWM, next);
            }
            GTCCR => self.prescaler.control_written(cpu, value),
            OCR2A | OCR2B => cpu.write_through(address, value),
            TCNT0 | TCNT2 => self.prescaler.count_written(cpu, address, value),
            UCSR0A => self.usart.status_written(cpu, value),
            UCSR0B => self.usart.control_written(cpu, value),
            UDR0 => {
                let done = self.usart.data_written(cpu, value);
                self.schedule(cpu, timer::SEND, done);
            }
            _ if flags::enable(cpu, address, value) => {}
            _ => cpu.write(address, value),
        }
    }

    fn io_read(&mut self, cpu: &Cpu, address: u16) -> u8 {
        match address {
            EECR => self.eeprom.control_read(cpu),
            ADCL | ADCH => self.adc.result_read(cpu, address),
            UDR0 => self.usart.data_read(cpu),
            _ => cpu.read(address),
        }
    }

    fn bit_set(&mut self, cpu: &Cpu, address: u16, bit: u8) {
        // The device clears the flag itself here, so that no notification of it arrives.
        if let Some(vector) = flags::clear_bit(cpu, address, bit) {
            self.adc.flag_cleared(vector);
        }
    }

    fn timer(&mut self, cpu: &Cpu, timer: u8, when: u64) -> Option<u64> {
        match timer {
            timer::PWM => self.pwm_due(cpu, when),
            timer::WORLD => self.world_due(cpu, when),
            timer::ADC => self.adc_due(cpu, when),
            timer::SEND => self.usart.sent(cpu, when),
            timer::RECEIVE => self.usart.received(cpu, when),
            _ => {
                self.eeprom.done(cpu);
                None
            }
        }
    }

    fn port_written(&mut self, cpu: &Cpu, port: Port, direction: bool, value: u8) {
        let register = match (port, direction) {
            (Port::B, false) => &mut self.outputs.port_b,
            (Port::B, true) => &mut self.outputs.direction_b,
            (Port::D, false) => &mut self.outputs.port_d,
            (Port::D, true) => &mut self.outputs.direction_d,
        };
        if *register != value {
            *register = value;
            let outputs = self.outputs;
            self.world.outputs_changed(cpu.now(), &outputs);
            self.attend(cpu);
        }
    }

    fn interrupt(&mut self, cpu: &Cpu, vector: u8, event: Interrupt) {
        match event {
            Interrupt::Raised => {
                let sample = self.adc.flag_raised(cpu, vector);
                self.schedule(cpu, timer::ADC, sample);
            }
            Interrupt::Cleared => self.adc.flag_cleared(vector),
            Interrupt::Entered => {
                self.meter.entered(vector, cpu.now());
                cpu.stall(RESPONSE_CYCLES + if cpu.slept() { WAKE_CYCLES } else { 0 });
            }
            Interrupt::Returned => {
                self.meter.returned(vector, cpu.now());
                match vector {
                    vector::USART_RX | vector::USART_UDRE => self.usart.handler_returned(cpu),
                    vector::EE_READY => self.eeprom.handler_returned(cpu),
                    _ => {}
                }
            }
        }
    }

    fn invalid_opcode(&mut self, cpu: &Cpu, opcode: u16) {
        let crash = Crash::InvalidOpcode { cycle: cpu.now(), address: cpu.program_counter(), opcode };
        self.crash.get_or_insert(crash);
    }

    fn after_reset(&mut self, cpu: &Cpu) {
        flags::timer2_compares(cpu, 0);
        self.adc.reset();
        self.pwm.reset();
        self.prescaler = Prescaler::default();
        let sent = self.usart.reset(cpu);
        self.schedule(cpu, timer::RECEIVE, sent);
        let written = self.eeprom.reset(cpu);
        self.schedule(cpu, timer::EEPROM, written);
        self.outputs = Outputs::default();
        self.world.outputs_changed(cpu.now(), &self.outputs);
        (self.inputs, self.wake_at) = (0, None);
        self.attend(cpu);
    }
}
