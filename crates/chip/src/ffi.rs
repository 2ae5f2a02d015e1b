//! The only module that talks to simavr's C code, and the only one with `unsafe` in it.
//!
//! [`Core`] owns one simulated ATmega328P and one [`Device`]. The device is the Rust model of everything simavr leaves
//! out or gets wrong. simavr calls back into the device while it runs; the device answers through a [`Cpu`].
//!
//! Ownership: the device lives in a `RefCell` inside a heap block that outlives the simulator. Callbacks only ever form
//! shared references to that block. A notification that arrives while the device is at work was caused by the device
//! itself: it drove a pin or raised an interrupt. It is not delivered.

use std::cell::{Cell, Ref, RefCell, RefMut};
use std::ffi::{c_int, c_void};

use simavr_ffi as sim;

use super::registers::{IO_BASE, OCR2A, SRAM_END, VECTORS};

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

/// The running chip as a device sees it.
pub(super) struct Cpu {
    avr: *mut sim::avr_t,
    vectors: [*mut sim::avr_int_vector_t; VECTORS],
    timer1: *mut sim::avr_timer_t,
    timer2: *mut sim::avr_timer_t,
    port_d: *mut sim::avr_irq_t,
    /// Cycles before the last reset; simavr counts from zero after each.
    epoch: Cell<u64>,
    /// Cycle of a reset that the run loop has not handled yet.
    reset_at: Cell<Option<u64>>,
    /// The processor slept when the present stretch began.
    slept: Cell<bool>,
    timer_callback: sim::avr_cycle_timer_t,
    timer_parameters: [*mut c_void; TIMERS],
    /// simavr's own handlers of the registers that were taken over, for [`Cpu::write_through`].
    originals: RefCell<Vec<(u16, sim::avr_io_write_t, *mut c_void)>>,
}

impl Cpu {
    /// Cycles since power-on, not restarted by resets.
    pub fn now(&self) -> u64 {
        // SAFETY: `avr` points to the simulator, which lives as long as this `Cpu`; nothing else runs now.
        self.epoch.get() + unsafe { (*self.avr).cycle }
    }

    /// Byte of data memory: registers, I/O, SRAM. Addresses beyond the SRAM read as 0.
    pub fn read(&self, address: u16) -> u8 {
        if address > SRAM_END {
            return 0;
        }
        // SAFETY: `data` has `ramend + 1` bytes and the address was checked against that.
        unsafe { *(*self.avr).data.add(address.into()) }
    }

    /// Writes a byte of data memory without any side effect; ignored beyond the SRAM.
    pub fn write(&self, address: u16, value: u8) {
        if address <= SRAM_END {
            // SAFETY: as in `read`.
            unsafe { *(*self.avr).data.add(address.into()) = value }
        }
    }

    /// Lets simavr's own handler of a register that was taken over act on a write.
    pub fn write_through(&self, address: u16, value: u8) {
        let original = self.originals.borrow().iter().find(|o| o.0 == address).copied();
        match original {
            // SAFETY: the handler and its parameter were installed by simavr for this register of this chip.
            Some((_, Some(handler), parameter)) => unsafe { handler(self.avr, address as _, value, parameter) },
            _ => self.write(address, value),
        }
    }

    /// Byte address of the instruction being executed.
    pub fn program_counter(&self) -> u32 {
        // SAFETY: see `now`.
        unsafe { (*self.avr).pc }
    }

    /// Lets `cycles` pass for the processor, as a halt or a response time does.
    pub fn stall(&self, cycles: u64) {
        // SAFETY: see `now`. The stretch that simavr may run before its next timer becomes shorter by as much; it must
        // not become 0, which would mean without limit.
        unsafe {
            (*self.avr).cycle += cycles;
            (*self.avr).run_cycle_count = (*self.avr).run_cycle_count.saturating_sub(cycles).max(1);
        }
    }

    /// Whether the processor slept when the current stretch began.
    pub fn slept(&self) -> bool {
        self.slept.get()
    }

    /// Raises an interrupt: sets its flag and, if it is enabled, requests it.
    pub fn raise(&self, vector: u8) {
        if let Some(&vector) = self.vectors.get(usize::from(vector)).filter(|v| !v.is_null()) {
            // SAFETY: the table holds simavr's own vectors of this chip.
            unsafe { sim::avr_raise_interrupt(self.avr, vector) };
        }
    }

    /// Clears the flag of an interrupt and its request.
    pub fn clear(&self, vector: u8) {
        if let Some(&vector) = self.vectors.get(usize::from(vector)).filter(|v| !v.is_null()) {
            // SAFETY: as in `raise`.
            unsafe { sim::avr_clear_interrupt(self.avr, vector) };
        }
    }

    /// Whether an interrupt is requested and waits for its turn.
    pub fn requested(&self, vector: u8) -> bool {
        match self.vectors.get(usize::from(vector)) {
            // SAFETY: as in `raise`.
            Some(&vector) if !vector.is_null() => unsafe { (*vector).pending() != 0 },
            _ => false,
        }
    }

    /// Start of a Timer1 period (some period, past or present) and its length in cycles; `None` while it stands.
    pub fn timer1_period(&self) -> Option<(u64, u64)> {
        // SAFETY: `timer1` points into this chip.
        let (base, length) = unsafe { ((*self.timer1).tov_base, (*self.timer1).tov_cycles) };
        (length > 0).then(|| (self.epoch.get() + base, length))
    }

    /// Cycles from the start of a Timer1 period to its compare match B.
    pub fn timer1_compare_b(&self) -> u64 {
        // SAFETY: as in `timer1_period`.
        unsafe { (*self.timer1).comp[1].comp_cycles }
    }

    /// Lets compare unit A (0) or B (1) of Timer2 work or rest. A resting unit raises no flag and costs the simulator
    /// nothing; the caller writes its compare register through afterwards, so that simavr arms it anew.
    pub fn set_timer2_compare(&self, unit: usize, works: bool) {
        let register = if works { OCR2A + unit as u16 } else { 0 };
        // SAFETY: `timer2` points into this chip, whose Timer2 has both units. Without a register simavr leaves the
        // unit out.
        unsafe { (&mut (*self.timer2).comp)[unit].r_ocr = register };
    }

    /// Sets the level of an input pin of port D.
    pub fn drive_port_d(&self, bit: u8, level: bool) {
        debug_assert!(bit < 8);
        // SAFETY: the port has an IRQ for each of its eight pins, and `bit` is one of them.
        unsafe { sim::avr_raise_irq(self.port_d.add(usize::from(bit & 7)), level.into()) }
    }

    /// Calls [`Device::timer`] at the cycle `at`, or as soon as possible if that has passed; replaces an earlier setting.
    pub fn schedule(&self, timer: u8, at: u64) {
        // simavr adds the present cycle again, so that an instant that has just passed keeps its exact value.
        let ahead = at.wrapping_sub(self.now());
        // SAFETY: callback and parameter belong to each other and live as long as the simulator.
        unsafe {
            let parameter = self.timer_parameters[usize::from(timer)];
            sim::avr_cycle_timer_register(self.avr, ahead, self.timer_callback, parameter);
        }
    }
}

/// Parameter of callbacks that have to tell one source from another.
struct Tag<D> {
    shared: *const Shared<D>,
    number: u16,
}

/// What the callbacks reach.
struct Shared<D> {
    cpu: Cpu,
    device: RefCell<D>,
    timers: Vec<Tag<D>>,
    ports: Vec<Tag<D>>,
    bits: Vec<Tag<D>>,
}

impl<D: Device> Shared<D> {
    /// Calls the device unless it is already at work.
    fn notify(&self, call: impl FnOnce(&mut D, &Cpu)) {
        if let Ok(mut device) = self.device.try_borrow_mut() {
            call(&mut device, &self.cpu);
        }
    }
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
            (*avr).sleep = Some(skip_sleep);
            (*avr).custom.data = shared.cast();
            (*avr).reset = Some(note_reset::<D>);
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
            vectors: unsafe { vectors(avr) },
            // SAFETY: the same.
            timer1: unsafe { timer1(avr) },
            // SAFETY: the same.
            timer2: unsafe { timer(avr, b'2') },
            // SAFETY: the same.
            port_d: unsafe { sim::avr_io_getirq(avr, port_ioctl(Port::D), 0) },
            epoch: Cell::new(0),
            reset_at: Cell::new(None),
            slept: Cell::new(false),
            timer_callback: Some(on_timer::<D>),
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
                slot.c = Some(on_read::<D>);
                slot.param = self.shared.cast();
            }
            for tag in &shared.bits {
                let slot = &mut (&mut (*avr).bit_io)[usize::from(tag.number - IO_BASE)];
                slot.c = Some(on_bit::<D>);
                slot.param = parameter(tag);
            }
            for (number, &vector) in shared.cpu.vectors.iter().enumerate().filter(|(_, v)| !v.is_null()) {
                let irq = &raw mut (*vector).irq;
                let running = irq.cast::<sim::avr_irq_t>().add(1);
                sim::avr_irq_register_notify(running, Some(on_running::<D>), self.shared.cast());
                if D::FLAGS.contains(&(number as u8)) {
                    sim::avr_irq_register_notify(irq.cast(), Some(on_flag::<D>), self.shared.cast());
                }
            }
            let opcode = sim::avr_get_core_irq(avr, 0);
            sim::avr_irq_register_notify(opcode, Some(on_invalid_opcode::<D>), self.shared.cast());
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
                    let irq = sim::avr_io_getirq(shared.cpu.avr, port_ioctl(port), index as c_int);
                    (*irq).flags &= !(sim::IRQ_FLAG_FILTERED as u8);
                    sim::avr_irq_register_notify(irq, Some(on_port::<D>), parameter(tag));
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
            slot.c = Some(on_write::<D>);
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

fn parameter<T>(tag: &T) -> *mut c_void {
    std::ptr::from_ref(tag).cast_mut().cast()
}

/// `AVR_IOCTL_IOPORT_GETIRQ`
fn port_ioctl(port: Port) -> u32 {
    let letter = match port {
        Port::B => b'B',
        Port::D => b'D',
    };
    u32::from_be_bytes([b'i', b'o', b'g', letter])
}

/// The interrupt vectors of the chip by number.
///
/// # Safety
/// `avr` is initialised.
unsafe fn vectors(avr: *mut sim::avr_t) -> [*mut sim::avr_int_vector_t; VECTORS] {
    let mut table = [std::ptr::null_mut(); VECTORS];
    // SAFETY: simavr's table holds `vector_count` valid pointers.
    unsafe {
        let interrupts = &(*avr).interrupts;
        for &vector in &interrupts.vector[..interrupts.vector_count.into()] {
            if let Some(slot) = table.get_mut(usize::from((*vector).vector)) {
                *slot = vector;
            }
        }
    }
    table
}

/// The timer with this digit.
///
/// # Safety
/// `avr` is an initialised ATmega328P.
unsafe fn timer(avr: *mut sim::avr_t, digit: u8) -> *mut sim::avr_timer_t {
    let ioctl = u32::from_be_bytes([b't', b'm', b'r', digit]);
    // SAFETY: `io_port` is simavr's list of the chip's modules; the one that answers to this code is the timer, whose
    // first field is the list's element.
    unsafe {
        let mut module = (*avr).io_port;
        while !module.is_null() && (*module).irq_ioctl_get != ioctl {
            module = (*module).next;
        }
        assert!(!module.is_null(), "simavr's ATmega328P has no such timer");
        module.cast()
    }
}

/// Timer1 of the chip, with its compare unit A cut off from the port. simavr would write PORTB1 with each edge of OC1A;
/// here `pwm` computes the pin's level.
///
/// # Safety
/// `avr` is an initialised ATmega328P.
unsafe fn timer1(avr: *mut sim::avr_t) -> *mut sim::avr_timer_t {
    // SAFETY: the caller's promise; the pin's IRQ exists.
    unsafe {
        let timer = timer(avr, b'1');
        let compare_a = (*timer).io.irq.add(sim::TIMER_IRQ_OUT_COMP as usize);
        sim::avr_unconnect_irq(compare_a, sim::avr_io_getirq(avr, port_ioctl(Port::B), 1));
        // Without this, the next reset would connect it again.
        (*timer).comp[0].com_pin.set_reg(0);
        timer
    }
}

/// simavr would sleep in real time here, and then let one cycle too many pass.
unsafe extern "C" fn skip_sleep(avr: *mut sim::avr_t, _cycles: u64) {
    // SAFETY: called by simavr with its own chip.
    unsafe { (*avr).cycle -= 1 }
}

unsafe extern "C" fn note_reset<D: Device>(avr: *mut sim::avr_t) {
    // SAFETY: `custom.data` was set to the block together with this handler.
    let shared = unsafe { &*(*avr).custom.data.cast::<Shared<D>>() };
    shared.cpu.reset_at.set(Some(shared.cpu.now()));
}

unsafe extern "C" fn on_write<D: Device>(
    _: *mut sim::avr_t,
    address: sim::avr_io_addr_t,
    value: u8,
    block: *mut c_void,
) {
    // SAFETY: installed with the block as its parameter.
    let shared = unsafe { &*block.cast::<Shared<D>>() };
    shared.notify(|device, cpu| device.io_write(cpu, address, value));
}

unsafe extern "C" fn on_read<D: Device>(_: *mut sim::avr_t, address: sim::avr_io_addr_t, block: *mut c_void) -> u8 {
    // SAFETY: installed with the block as its parameter.
    let shared = unsafe { &*block.cast::<Shared<D>>() };
    shared.device.borrow_mut().io_read(&shared.cpu, address)
}

unsafe extern "C" fn on_bit<D: Device>(_: *mut sim::avr_t, bit: u8, value: u8, tag: *mut c_void) -> c_int {
    // SAFETY: installed with a tag as its parameter, whose block lives as long.
    let (shared, address) = unsafe { (&*(*tag.cast::<Tag<D>>()).shared, (*tag.cast::<Tag<D>>()).number) };
    if value != 0 {
        shared.notify(|device, cpu| device.bit_set(cpu, address, bit));
    }
    1
}

unsafe extern "C" fn on_timer<D: Device>(_: *mut sim::avr_t, when: u64, tag: *mut c_void) -> u64 {
    // SAFETY: registered with a tag as its parameter, whose block lives as long.
    let (shared, number) = unsafe { (&*(*tag.cast::<Tag<D>>()).shared, (*tag.cast::<Tag<D>>()).number as u8) };
    if number == STOP_TIMER {
        return 0;
    }
    let cpu = &shared.cpu;
    let next = match shared.device.try_borrow_mut() {
        Ok(mut device) => device.timer(cpu, number, cpu.epoch.get() + when),
        Err(_) => None,
    };
    match next {
        None => 0,
        Some(next) if next > cpu.now() => next - cpu.epoch.get(),
        // simavr would call back at once, before other timers that are due earlier.
        Some(next) => {
            cpu.schedule(number, next);
            0
        }
    }
}

unsafe extern "C" fn on_port<D: Device>(irq: *mut sim::avr_irq_t, value: u32, tag: *mut c_void) {
    // SAFETY: registered with a tag as its parameter, whose block lives as long; simavr passes a valid IRQ.
    let (shared, number, index) =
        unsafe { (&*(*tag.cast::<Tag<D>>()).shared, (*tag.cast::<Tag<D>>()).number, (*irq).irq) };
    let port = if number == 0 { Port::B } else { Port::D };
    let direction = index == sim::IOPORT_IRQ_DIRECTION_ALL;
    shared.notify(|device, cpu| device.port_written(cpu, port, direction, value as u8));
}

unsafe extern "C" fn on_flag<D: Device>(irq: *mut sim::avr_irq_t, value: u32, block: *mut c_void) {
    // SAFETY: registered with the block as its parameter; the IRQ's number holds the vector above its low byte.
    let (shared, vector) = unsafe { (&*block.cast::<Shared<D>>(), ((*irq).irq >> 8) as u8) };
    let event = if value != 0 { Interrupt::Raised } else { Interrupt::Cleared };
    shared.notify(|device, cpu| device.interrupt(cpu, vector, event));
}

unsafe extern "C" fn on_running<D: Device>(irq: *mut sim::avr_irq_t, value: u32, block: *mut c_void) {
    // SAFETY: as in `on_flag`.
    let (shared, vector) = unsafe { (&*block.cast::<Shared<D>>(), ((*irq).irq >> 8) as u8) };
    let event = if value != 0 { Interrupt::Entered } else { Interrupt::Returned };
    shared.notify(|device, cpu| device.interrupt(cpu, vector, event));
}

unsafe extern "C" fn on_invalid_opcode<D: Device>(_: *mut sim::avr_irq_t, opcode: u32, block: *mut c_void) {
    // SAFETY: registered with the block as its parameter.
    let shared = unsafe { &*block.cast::<Shared<D>>() };
    shared.notify(|device, cpu| device.invalid_opcode(cpu, opcode as u16));
    // simavr would step over it and go on.
    // SAFETY: called while the chip runs, on its own behalf.
    unsafe { (*shared.cpu.avr).state = sim::cpu_Crashed as c_int };
}
