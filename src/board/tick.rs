//! The control tick: Timer0's compare A, every 250 counts of 64 cycles (125 at 2 kHz), without drift.
//!
//! The handler takes its inputs with interrupts off (the encoder waits), then lets them on and computes. Tick and main
//! loop share the control loop by turns. The main loop touches it only right after a tick, and holds the tick's interrupt
//! back for a few microseconds.

#![expect(
    clippy::deref_addrof,
    reason = "a raw pointer first: a reference to a static that an interrupt shares is refused"
)]

use super::{adc, bridge, encoder, registers, stack, watchdog};
use avr_device::atmega328p::Peripherals;
use avr_device::interrupt::CriticalSection;
use core::mem::MaybeUninit;
use core::sync::atomic::{Ordering, compiler_fence};
use motorbench_board::pins;
use motorbench_core::control_loop::{ControlLoop, Inputs, LoopConfig};
use motorbench_core::message::{Request, Sample, WAITING};
use motorbench_core::settings::{BuildError, Param, Settings};

/// The control loop; all zeros are a valid one.
static mut LOOP: MaybeUninit<ControlLoop> = MaybeUninit::zeroed();
/// Where the main loop builds a configuration before the tick gets it; numbers and flags, so that zeros are valid.
static mut STAGED: MaybeUninit<LoopConfig> = MaybeUninit::zeroed();
/// What the tick saw last. Named, so that a simulation can read it.
#[unsafe(no_mangle)]
static mut TICK_INPUTS: Inputs = Inputs {
    edges: motorbench_core::encoder::Edges { count: 0, step: 0, coarse: 0, fine: 0, illegal: 0 },
    tick_coarse: 0,
    current_sum: 0,
    tacho: 0,
    supply: 0,
    duty_scale: 0,
    flags: 0,
};
/// The request that waits for the next tick. Named, so that a simulation can read it.
#[unsafe(no_mangle)]
static mut TICK_REQUEST: Option<Request> = None;

/// Samples on their way to the main loop: one writer, one reader.
static mut SAMPLES: [MaybeUninit<Sample>; RING] = [const { MaybeUninit::uninit() }; RING];
const RING: usize = WAITING as usize;

/// Bytes that tick and main loop share; one writer each.
struct Shared {
    /// Ticks, modulo 256.
    ticks: u8,
    /// Samples put into the ring, modulo 256.
    written: u8,
    /// Samples taken out, modulo 256.
    read: u8,
    /// Samples that found the ring full, modulo 2^16.
    dropped: u16,
    /// Flags of the next [`Inputs`].
    flags: u8,
    duty_scale: u16,
    /// Timer0 counts of one tick.
    period: u8,
    coasting: bool,
    hung: bool,
    /// A request waits for the tick.
    pending: bool,
}

static mut SHARED: Shared = Shared {
    ticks: 0,
    written: 0,
    read: 0,
    dropped: 0,
    flags: 0,
    duty_scale: 0,
    period: 250,
    coasting: false,
    hung: false,
    pending: false,
};

macro_rules! shared {
    ($field:ident) => {
        // SAFETY: one byte, or read and written with interrupts off; volatile, because two contexts share it.
        unsafe { (&raw const SHARED.$field).read_volatile() }
    };
    ($field:ident = $value:expr) => {{
        let value = $value;
        // SAFETY: as above; each field has one writer at a time.
        unsafe { (&raw mut SHARED.$field).write_volatile(value) }
    }};
}

const OCIE0A: u8 = 0b10;

/// Makes the control loop, still without a configuration; to be called before anything else here.
pub fn prepare() {
    with_loop(|control| control.begin(encoder::edges(&registers())));
}

/// Gives the tick a configuration, as a whole, between two ticks.
///
/// # Errors
/// A setting that does not fit; nothing has changed then.
#[inline(never)]
pub fn configure(settings: &Settings) -> Result<(), BuildError> {
    // SAFETY: valid from the start; only the main loop stages.
    let staged = unsafe { (*(&raw mut STAGED)).assume_init_mut() };
    staged.rebuild(settings)?;
    with_loop(|control| control.configure(staged));
    set_hardware(settings);
    Ok(())
}

/// Prepares the timer; it already runs as the encoder's time stamp.
pub fn start(p: &Peripherals) {
    // SAFETY: any value is valid.
    p.TC0.ocr0a().write(|w| unsafe { w.bits(p.TC0.tcnt0().read().bits().wrapping_add(250)) });
}

/// Counts of Timer0 from the beginning of a period of the PWM to a tick. The rig file of a recording relies on it: it says
/// how periods, conversions and ticks lie in time.
const PERIOD_AHEAD: u8 = 7;

/// Lets the tick run, and with it PWM and sampling. However long the start has taken, the PWM begins a fixed time before a
/// tick is due, and a round of conversions when it is. So each tick finds the conversions of the millisecond before it.
pub fn run(p: &Peripherals) {
    let count = || p.TC0.tcnt0().read().bits();
    let ahead = p.TC0.ocr0a().read().bits().wrapping_sub(PERIOD_AHEAD);
    // From the beginning of that count, and to the eighth of a count.
    while count() == ahead {}
    while count() != ahead {}
    avr_device::asm::nop5();
    avr_device::asm::nop3();
    bridge::run(p);
    // SAFETY: writing a one clears the flag; it comes within 256 counts.
    p.TC0.tifr0().write(|w| unsafe { w.bits(OCIE0A) });
    while p.TC0.tifr0().read().bits() & OCIE0A == 0 {}
    adc::start(p);
    enable(p);
}

fn enable(p: &Peripherals) {
    // SAFETY: the compare interrupt and nothing else.
    p.TC0.timsk0().write(|w| unsafe { w.bits(OCIE0A) });
}

/// Runs `work` on the control loop, right after a tick and undisturbed by the next.
pub fn with_loop<T>(work: impl FnOnce(&mut ControlLoop) -> T) -> T {
    wait();
    let p = registers();
    let enabled = p.TC0.timsk0().read().bits();
    // SAFETY: no interrupt of this timer; between two ticks by the wait above.
    p.TC0.timsk0().write(|w| unsafe { w.bits(0) });
    // SAFETY: the tick, the only other user, cannot run now.
    let result = work(unsafe { (*(&raw mut LOOP)).assume_init_mut() });
    // SAFETY: as it was.
    p.TC0.timsk0().write(|w| unsafe { w.bits(enabled) });
    result
}

/// Waits for the end of the next tick; not at all before the first.
#[inline(never)]
pub fn wait() {
    let now = shared!(ticks);
    let p = registers();
    while shared!(ticks) == now && p.TC0.timsk0().read().bits() != 0 {
        mark_alive();
    }
}

/// Hands a request to the next tick; waits only for the one before.
pub fn request(request: Request) {
    while shared!(pending) {
        mark_alive();
    }
    // SAFETY: the tick has taken the request before, and looks at this one only when it is marked as pending.
    unsafe { (&raw mut TICK_REQUEST).write(Some(request)) }
    // The compiler must not move the request behind its mark.
    compiler_fence(Ordering::SeqCst);
    shared!(pending = true);
}

/// Copies the next sample that was not taken yet; false if there is none.
pub fn take_sample(sample: &mut Sample) -> bool {
    let read = shared!(read);
    if read == shared!(written) {
        return false;
    }
    // SAFETY: this place was written before `written` passed it, and is not written again before `read` does.
    *sample = unsafe { (*(&raw const SAMPLES))[read as usize % RING].assume_init() };
    // The tick takes the place at once: the copy must not come later.
    compiler_fence(Ordering::SeqCst);
    shared!(read = read.wrapping_add(1));
    true
}

/// Leaves the samples that were not taken yet.
pub fn skip_samples() {
    shared!(read = shared!(written));
}

/// Ticks so far, modulo 256.
pub fn count() -> u8 {
    shared!(ticks)
}

/// Samples lost because the main loop did not take them.
pub fn dropped() -> u16 {
    avr_device::interrupt::free(|_| shared!(dropped))
}

/// Tells the tick that the main loop goes round, and whether the host has spoken; and the [`duty_scale`] of the supply.
///
/// [`duty_scale`]: motorbench_core::control_loop::duty_scale
pub fn keep_alive(host_spoke: bool, duty_scale: u16) {
    let flags = Inputs::MAIN_LOOP_ALIVE | if host_spoke { Inputs::HOST_SPOKE } else { 0 };
    avr_device::interrupt::free(|_| {
        shared!(flags = shared!(flags) | flags);
        shared!(duty_scale = duty_scale);
    });
}

/// Marks the main loop as alive while it waits.
pub fn mark_alive() {
    avr_device::interrupt::free(|_| shared!(flags = shared!(flags) | Inputs::MAIN_LOOP_ALIVE));
}

/// Tick rate and wiring.
fn set_hardware(settings: &Settings) {
    let period = if settings.is_fast() { 125 } else { 250 };
    let coasting = settings.get(Param::Wiring) != 0.0;
    avr_device::interrupt::free(|_| {
        shared!(period = period);
        shared!(coasting = coasting);
    });
}

/// Everything the tick sees, at one instant. Interrupts are off.
#[inline(always)]
fn take_inputs(p: &Peripherals) -> &'static Inputs {
    // SAFETY: in a handler, interrupts are off.
    let cs = unsafe { CriticalSection::new() };
    let (mut current_sum, tacho, supply) = adc::latest(cs);
    let tick_coarse = p.TC0.ocr0a().read().bits();
    let next = tick_coarse.wrapping_add(shared!(period));
    // SAFETY: any value is valid.
    p.TC0.ocr0a().write(|w| unsafe { w.bits(next) });
    let mut flags = shared!(flags);
    shared!(flags = 0);
    if p.PORTD.pind().read().bits() & pins::EMERGENCY_STOP.mask() == 0 {
        flags |= Inputs::STOP_CLOSED;
    }
    if stack::overflown() {
        flags |= Inputs::STACK_OVERFLOW;
    }
    if current_sum == adc::TAKEN {
        flags |= Inputs::NOT_CONVERTED;
        // SAFETY: the tick does not nest, and nobody else uses the inputs.
        current_sum = unsafe { (&raw const TICK_INPUTS.current_sum).read_volatile() };
    }
    let edges = encoder::edges(p);
    let inputs = Inputs { edges, tick_coarse, current_sum, tacho, supply, duty_scale: shared!(duty_scale), flags };
    // SAFETY: the tick does not nest, and nobody else uses the inputs.
    unsafe {
        (&raw mut TICK_INPUTS).write(inputs);
        &*(&raw const TICK_INPUTS)
    }
}

// The control tick.
#[avr_device::interrupt(atmega328p)]
fn TIMER0_COMPA() {
    let p = registers();
    let inputs = take_inputs(&p);
    // The tick must not interrupt itself, everything else may.
    // SAFETY: no interrupt of this timer until the end.
    p.TC0.timsk0().write(|w| unsafe { w.bits(0) });
    // SAFETY: everything shared has been taken.
    unsafe { avr_device::interrupt::enable() };
    // SAFETY: valid from the start; the main loop keeps away while the tick may run.
    let control = unsafe { (*(&raw mut LOOP)).assume_init_mut() };
    // SAFETY: while it is pending, the main loop does not touch it.
    let request = if shared!(pending) { unsafe { (*(&raw const TICK_REQUEST)).as_ref() } } else { None };
    let drive = control.tick_with(request, inputs);
    if request.is_some() {
        // SAFETY: as above.
        unsafe { (&raw mut TICK_REQUEST).write(None) };
        compiler_fence(Ordering::SeqCst);
        shared!(pending = false);
    }
    bridge::apply(&p, &drive, shared!(coasting));
    put(control.sample());
    guard(control.main_loop_hung(), inputs.flags & Inputs::STACK_OVERFLOW != 0);
    avr_device::interrupt::disable();
    enable(&p);
    shared!(ticks = shared!(ticks).wrapping_add(1));
}

/// Puts the sample into the ring.
#[inline(always)]
fn put(sample: &Sample) {
    let written = shared!(written);
    if written.wrapping_sub(shared!(read)) as usize >= RING {
        avr_device::interrupt::free(|_| shared!(dropped = shared!(dropped).wrapping_add(1)));
        return;
    }
    // SAFETY: the reader is not at this place.
    let place = unsafe { (*(&raw mut SAMPLES))[written as usize % RING].as_mut_ptr() };
    copy(sample, place);
    shared!(written = written.wrapping_add(1));
}

/// Copies a sample: in half the time of a call of memcpy, which counts the bytes.
#[inline(always)]
fn copy(from: &Sample, to: *mut Sample) {
    // SAFETY: reads and writes as many bytes as a sample has.
    unsafe {
        core::arch::asm!(
            ".rept {bytes}",
            "ld {byte}, X+",
            "st Z+, {byte}",
            ".endr",
            bytes = const size_of::<Sample>(),
            byte = out(reg) _,
            inout("X") from => _,
            inout("Z") to => _,
            options(nostack)
        );
    }
}

/// Feeds the watchdog as long as the main loop lives and the stack is whole; which was not is reported after the reset that
/// follows.
#[inline(always)]
fn guard(hung: bool, overflown: bool) {
    if hung || overflown {
        shared!(hung = true);
        watchdog::given_up(overflown);
    }
    if !shared!(hung) {
        avr_device::asm::wdr();
    }
}
