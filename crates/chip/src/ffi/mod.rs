//! The only module that talks to simavr's C code, and the only one with `unsafe` in it.
//!
//! [`Core`] owns one simulated ATmega328P and one [`Device`]. The device is the Rust model of everything simavr leaves
//! out or gets wrong. simavr calls back into the device while it runs; the device answers through a [`Cpu`].
//!
//! Ownership: the device lives in a `RefCell` inside a heap block that outlives the simulator. Callbacks only ever form
//! shared references to that block. A notification that arrives while the device is at work was caused by the device
//! itself: it drove a pin or raised an interrupt. It is not delivered.

mod callbacks;
mod cpu;
mod parts;

use std::cell::{Cell, Ref, RefCell, RefMut};
use std::ffi::{c_int, c_void};

use simavr_ffi as sim;

use super::registers::IO_BASE;
use callbacks::{Shared, Tag, parameter};
pub(super) use cpu::Cpu;

/// Number of cycle timers a device has.
pub(super) const TIMERS: usize = 8;
/// Timer reserved for the end of a run.
const STOP_TIMER: u8 = TIMERS as u8 - 1;
/// Cycles that simavr may run without looking up: only its cycle timers end a stretch.
const RUN_LIMIT: u64 = 1_000_000;

/// A port of the chip that is watched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Port {
    B,
    D,
}

/// What happened to an interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Interrupt {
    /// Its flag was set.
    Raised,
    /// Its flag was cleared.
    Cleared,
    /// The processor jumps to its vector now; the response has just begun.
    Entered,
    /// The processor executes the RETI.
    Returned,
}

/// The Rust side of the chip.
pub(super) trait Device {
    /// Data addresses whose writes go to [`Device::io_write`].
    const WRITES: &'static [u16];
    /// Data addresses whose reads go to [`Device::io_read`].
    const READS: &'static [u16];
    /// Data addresses below 0x40 whose SBI goes to [`Device::bit_set`]; CBI does nothing there.
    const BITS: &'static [u16];
    /// Vectors whose flag is watched.
    const FLAGS: &'static [u8];

    fn io_write(&mut self, cpu: &Cpu, address: u16, value: u8);
    fn io_read(&mut self, cpu: &Cpu, address: u16) -> u8;
    fn bit_set(&mut self, cpu: &Cpu, address: u16, bit: u8);
    /// A timer set with [`Cpu::schedule`] for the cycle `when` is due; the processor may be a few cycles further.
    /// Returns when it is due again, which is after `when`.
    fn timer(&mut self, cpu: &Cpu, timer: u8, when: u64) -> Option<u64>;
    /// The output register (`direction` false) or the direction register of a port was written.
    fn port_written(&mut self, cpu: &Cpu, port: Port, direction: bool, value: u8);
    fn interrupt(&mut self, cpu: &Cpu, vector: u8, event: Interrupt);
    fn invalid_opcode(&mut self, cpu: &Cpu, opcode: u16);
    /// The chip has been reset and stands before its first instruction.
    fn after_reset(&mut self, cpu: &Cpu);
}

/// What a run of the simulator ended with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    Running,
    /// The processor sleeps with interrupts off: nothing but a reset can wake it.
    Dead,
}

/// A simulated ATmega328P with its device.
pub(super) struct Core<D: Device> {
    shared: *mut Shared<D>,
}

impl<D: Device> Core<D> {
    /// A chip at 16 MHz and 5 V with empty flash, after a power-on reset.
    ///
    /// # Panics
    /// If simavr does not know the ATmega328P, which would be a broken build of it.
    pub fn new(device: D) -> Self {
        // SAFETY: the name is a C string; the result is checked. `avr_init` completes the chip before anything else
        // touches it, and `custom.data` is only used by the reset handler installed with it.
        unsafe {
            let avr = sim::avr_make_mcu_by_name(c"atmega328p".as_ptr());
            assert!(!avr.is_null(), "simavr does not know the ATmega328P");
            sim::avr_init(avr);
            let shared = Self::connect(avr, device);
            (*avr).frequency = motorbench_core::HARDWARE.clock_hz;
            (*avr).options.set_no_pullups(1);
            (*avr).sleep = Some(callbacks::skip_sleep);
            (*avr).custom.data = shared.cast();
            (*avr).reset = Some(callbacks::note_reset::<D>);
            let core = Self { shared };
            core.install();
            core
        }
    }

    /// Makes the block that the callbacks reach, with its pointers to itself.
    ///
    /// # Safety
    /// `avr` is an initialised ATmega328P.
    unsafe fn connect(avr: *mut sim::avr_t, device: D) -> *mut Shared<D> {
        let cpu = Cpu {
            avr,
            // SAFETY: the caller's promise.
            vectors: unsafe { parts::vectors(avr) },
            // SAFETY: the same.
            timer1: unsafe { parts::timer1(avr) },
            // SAFETY: the same.
            timer2: unsafe { parts::timer(avr, b'2') },
            // SAFETY: the same.
            port_d: unsafe { sim::avr_io_getirq(avr, parts::port_ioctl(Port::D), 0) },
            epoch: Cell::new(0),
            reset_at: Cell::new(None),
            slept: Cell::new(false),
            timer_callback: Some(callbacks::on_timer::<D>),
            timer_parameters: [std::ptr::null_mut(); TIMERS],
            originals: RefCell::default(),
        };
        let shared = Shared { cpu, device: RefCell::new(device), timers: vec![], ports: vec![], bits: vec![] };
        let shared = Box::into_raw(Box::new(shared));
        let block = shared.cast_const();
        let tag = |number: u16| Tag { shared: block, number };
        // SAFETY: the block was made just now and nobody else knows it yet. The vectors are never changed again, so the
        // addresses of their elements stay.
        unsafe {
            (*shared).timers = (0..TIMERS as u16).map(tag).collect();
            (*shared).ports = (0..2).map(tag).collect();
            (*shared).bits = D::BITS.iter().map(|&address| tag(address)).collect();
            for number in 0..TIMERS {
                (*shared).cpu.timer_parameters[number] = parameter(&(&(*shared).timers)[number]);
            }
        }
        shared
    }

    /// Puts the callbacks in place.
    fn install(&self) {
        let shared = self.shared();
        D::WRITES.iter().for_each(|&address| self.take_over_writes(address));
        let avr = shared.cpu.avr;
        // SAFETY: the simulator does not run. All parameters point into the block, which outlives the simulator.
        unsafe {
            for &address in D::READS {
                let slot = &mut (&mut (*avr).io)[usize::from(address - IO_BASE)].r;
                slot.c = Some(callbacks::on_read::<D>);
                slot.param = self.shared.cast();
            }
            for tag in &shared.bits {
                let slot = &mut (&mut (*avr).bit_io)[usize::from(tag.number - IO_BASE)];
                slot.c = Some(callbacks::on_bit::<D>);
                slot.param = parameter(tag);
            }
            for (number, &vector) in shared.cpu.vectors.iter().enumerate().filter(|(_, v)| !v.is_null()) {
                let irq = &raw mut (*vector).irq;
                let running = irq.cast::<sim::avr_irq_t>().add(1);
                sim::avr_irq_register_notify(running, Some(callbacks::on_running::<D>), self.shared.cast());
                if D::FLAGS.contains(&(number as u8)) {
                    sim::avr_irq_register_notify(irq.cast(), Some(callbacks::on_flag::<D>), self.shared.cast());
                }
            }
            let opcode = sim::avr_get_core_irq(avr, 0);
            sim::avr_irq_register_notify(opcode, Some(callbacks::on_invalid_opcode::<D>), self.shared.cast());
            self.install_ports();
        }
    }

    /// Watches what the program writes to ports B and D.
    ///
    /// # Safety
    /// The simulator does not run.
    unsafe fn install_ports(&self) {
        let shared = self.shared();
        for (port, tag) in [Port::B, Port::D].into_iter().zip(&shared.ports) {
            for index in [sim::IOPORT_IRQ_DIRECTION_ALL, sim::IOPORT_IRQ_REG_PORT] {
                // SAFETY: the port exists; the flag is cleared so that equal values after a reset are told as well.
                unsafe {
                    let irq = sim::avr_io_getirq(shared.cpu.avr, parts::port_ioctl(port), index as c_int);
                    (*irq).flags &= !(sim::IRQ_FLAG_FILTERED as u8);
                    sim::avr_irq_register_notify(irq, Some(callbacks::on_port::<D>), parameter(tag));
                }
            }
        }
    }

    /// Sends the writes to a register to the device from now on, as those of [`Device::WRITES`] are.
    pub fn take_over_writes(&self, address: u16) {
        let cpu = &self.shared().cpu;
        let mut originals = cpu.originals.borrow_mut();
        if originals.iter().any(|o| o.0 == address) {
            return;
        }
        // SAFETY: the simulator does not run; the index is checked by the array.
        unsafe {
            let slot = &mut (&mut (*cpu.avr).io)[usize::from(address - IO_BASE)].w;
            originals.push((address, slot.c, slot.param));
            slot.c = Some(callbacks::on_write::<D>);
            slot.param = self.shared.cast();
        }
    }

    fn shared(&self) -> &Shared<D> {
        // SAFETY: made by `Box::into_raw`, freed only in `drop`, and only ever borrowed shared.
        unsafe { &*self.shared }
    }

    /// The chip.
    pub fn cpu(&self) -> &Cpu {
        &self.shared().cpu
    }

    /// The device.
    pub fn device(&self) -> Ref<'_, D> {
        self.shared().device.borrow()
    }

    /// The device, to change.
    pub fn device_mut(&mut self) -> RefMut<'_, D> {
        self.shared().device.borrow_mut()
    }

    /// Calls the device with its chip.
    pub fn with_device<R>(&mut self, call: impl FnOnce(&mut D, &Cpu) -> R) -> R {
        let shared = self.shared();
        call(&mut shared.device.borrow_mut(), &shared.cpu)
    }

    /// Copies `code` into the flash.
    ///
    /// # Panics
    /// If it does not fit.
    pub fn load(&mut self, address: u32, code: &[u8]) {
        let avr = self.cpu().avr;
        // SAFETY: the range is checked before it is copied; simavr only reads the slice.
        unsafe {
            assert!(address as usize + code.len() <= (*avr).flashend as usize + 1, "program exceeds the flash");
            sim::avr_loadcode(avr, code.as_ptr().cast_mut(), code.len() as u32, address);
        }
    }

    /// Resets the chip. SRAM and the reset flags of MCUSR are kept.
    pub fn reset(&mut self) {
        // SAFETY: the simulator does not run.
        unsafe { sim::avr_reset(self.cpu().avr) };
        self.finish_reset();
    }

    fn finish_reset(&mut self) -> bool {
        let cpu = self.cpu();
        let Some(cycle) = cpu.reset_at.take() else { return false };
        cpu.epoch.set(cycle);
        // SAFETY: the simulator does not run.
        unsafe {
            (*cpu.avr).run_cycle_limit = RUN_LIMIT;
        }
        self.with_device(|device, cpu| device.after_reset(cpu));
        true
    }

    /// Runs until the cycle `end` has been reached, to the end of the instruction then running.
    pub fn run_until(&mut self, end: u64) -> Progress {
        self.cpu().schedule(STOP_TIMER, end);
        while self.cpu().now() < end {
            if self.run_stretch() == Progress::Dead {
                return Progress::Dead;
            }
            if self.finish_reset() {
                self.cpu().schedule(STOP_TIMER, end);
            }
        }
        Progress::Running
    }

    /// Executes one instruction (and an interrupt response that follows it), or sleeps until the next event.
    pub fn step(&mut self) -> Progress {
        let avr = self.cpu().avr;
        // SAFETY: the simulator does not run.
        unsafe { (*avr).run_cycle_limit = 1 };
        // SAFETY: the same.
        unsafe { (*avr).run_cycle_count = 1 };
        let progress = self.run_stretch();
        // SAFETY: the same.
        unsafe { (*avr).run_cycle_limit = RUN_LIMIT };
        self.finish_reset();
        progress
    }

    /// Runs to the next event.
    fn run_stretch(&mut self) -> Progress {
        let cpu = self.cpu();
        // SAFETY: no reference into the device is alive: they all borrow from this `Core`, which is borrowed mutably.
        let state = unsafe {
            cpu.slept.set((*cpu.avr).state == sim::cpu_Sleeping as c_int);
            sim::avr_run(cpu.avr)
        };
        match state as u32 {
            sim::cpu_Running | sim::cpu_Sleeping => Progress::Running,
            _ => Progress::Dead,
        }
    }
}

impl<D: Device> Drop for Core<D> {
    fn drop(&mut self) {
        unsafe extern "C" {
            fn free(block: *mut c_void);
        }
        let avr = self.cpu().avr;
        // SAFETY: simavr made the chip with `malloc`; after `avr_terminate` nothing of it is used any more. The block
        // came from `Box::into_raw`.
        unsafe {
            sim::avr_terminate(avr);
            free(avr.cast());
            drop(Box::from_raw(self.shared));
        }
    }
}
