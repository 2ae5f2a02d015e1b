//! What the console says. All of it stands in flash.

use crate::flash_text::{FlashText, Table};
use crate::message::Trip;

macro_rules! texts {
    ($enumeration:ident $table:ident: $($name:ident $text:expr;)*) => {
        /// Texts by name; the discriminant is the place in the table.
        #[derive(Clone, Copy, PartialEq, Eq)]
        #[repr(u8)]
        #[allow(dead_code, reason = "most words are reached by their distance from the first of their kind")]
        pub(super) enum $enumeration { $($name),* }

        pub(crate) const $table: &str = concat!($($text, "\0"),*);
    };
}

texts! { Say SAYINGS:
    Ok "ok";
    Error "error: ";
    UnknownCommand "unknown command, see help";
    LineRefused "line too long or not ASCII";
    Usage "expected %0 %1";
    NoSuchSetting "no such setting";
    TripLatched "trip %T %t, %A s ago; clear it";
    NotLoaded "saved settings are of another version: not loaded, defaults in force; save, set, load or defaults first";
    NotArmed "arm first";
    DisarmFirst "disarm first";
    SaveRunning "save still running";
    NothingSaved "nothing saved by this version";
    Range "%3 expected a number in %4 %l..%h";
    Limit "expected a number in -%L..%L";
    PeriodLimit "expected PERIOD 0..%L";
    CountLimit "expected COUNT 0..%L";
    Build "%3 %b";
    NoReference "mode is off";
    ZeroRefused "zero refused: a current flows";
    Command "%0 %1";
    Setting "%3 %x %4 %l..%h";
    Version "motorbench %V, settings %S";
    ResetCause "reset: %R";
    State "mode %m armed %a trip %T %t";
    Measured "reference %r position %p rad, speed %s rad/s, current %c A, duty %d percent, supply %v V";
    Counted "illegal transitions %i, serial overruns %o, unsent bytes %u, dropped samples %D, stack free %f, reset: %R";
    Done "done: %k samples, dropped %K";
    Saved "saved";
    Plot "reference:%r,position:%p,speed:%s,current:%c,duty:%d";
}

// In the order of the trips, the reset causes and the rules, so that a number of each is a place here.
texts! { Word WORDS:
    Trips "none";
    OverCurrentPeak "over-current, peak";
    OverCurrentThermal "over-current, thermal";
    Stall "stall: driven, not turning";
    EncoderSilent "encoder silent: driven, no counts";
    Runaway "runaway: wrong feedback sign";
    SensorRange "current sensor: a rail, or current when off";
    SupplyRange "supply out of range";
    EmergencyStop "emergency stop";
    HostLost "host silent";
    MainLoopHung "main loop hung";
    EncoderTooFew "encoder counts too few";
    EncoderLines "encoder line open or shorted";
    ConverterSilent "converter silent";
    StackOverflow "stack overflow";
    ResetCauses "unknown";
    PowerOn "power on";
    External "external";
    BrownOut "brown-out";
    Watchdog "watchdog";
    ResetMainLoopHung "main loop hung";
    Panic "panic";
    ResetStack "stack overflow";
    Rules "is too large for fixed point";
    TooSmall "is below its range";
    RoundsToZero "rounds to zero in fixed point";
    NotPowerOfTwo "must be a power of two";
    NotAllowed "is not allowed";
    NotFinite "must be a number";
    Version env!("CARGO_PKG_VERSION");
    Modes "off";
    OpenLoop "open";
    SpeedPid "speed";
    PositionPid "position";
    SpeedLqr "lqr_speed";
    PositionLqr "lqr_position";
}

/// The words for a trip, as `status` has them.
pub fn trip_text(trip: Trip) -> FlashText {
    FlashText::of(Table::Words, Word::Trips as u8 + trip as u8)
}
