//! The commands: their names, their arguments and what each does.

use super::Form;

macro_rules! commands {
    ($($variant:ident $name:literal $arguments:literal $help:literal;)*) => {
        /// The commands, in the order of `COMMAND_TEXT`.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        #[repr(u8)]
        pub(super) enum Command { $($variant),* }

        const COMMANDS: &[Command] = &[$(Command::$variant),*];

        /// What each takes.
        pub(super) const FORMS: [Form; COMMANDS.len()] = [$(Form::of($arguments)),*];
        pub(super) const COMMAND_COUNT: u8 = COMMANDS.len() as u8;
        /// Name and arguments of each.
        pub(crate) const COMMAND_TEXT: &str = concat!($($name, "\0", $arguments, "\0"),*);
        /// What each does, in one line. The chip does not carry these: the host program shows them.
        #[cfg(not(target_arch = "avr"))]
        pub(super) const COMMAND_HELP: [&str; COMMANDS.len()] = [$($help),*];
    };
}

// A command is searched for in this order. Those that steer a running motor come first: they must not hold up the
// telemetry. The second text gives the arguments, and the command's form is made of it. Words in lower case are the choice
// of the first argument, and words in capitals are values. Those in brackets may be left out, and `...` goes on to the end
// of the line.
commands! {
    Reference "ref" "VALUE" "V -32..32 (open), rad/s within speed_range (speed), rad (position)";
    Mode "mode" "off|open|speed|position|lqr_speed|lqr_position" "who sets the voltage";
    Alive "alive" "" "keep-alive, see trip_host";
    Stop "stop" "" "mode off, motor brakes, stays armed";
    Disarm "disarm" "" "bridge off, motor coasts";
    Arm "arm" "" "allow the drive; mode is off";
    Set "set" "NAME VALUE [NAME VALUE ...]" "change settings, all or none, at one tick";
    Status "status" "" "state, measurements, counters";
    Show "show" "[NAME]" "settings: value, unit, range";
    Sequence "sequence" "steps|ramp|stairs|prbs|levels|chirp|coast|identify AMPLITUDE [OFFSET PERIOD COUNT SEED]" "play as reference: unit of the mode, PERIOD in ms; numbers 0..65535, less where a kind needs it";
    Record "record" "steps|ramp|stairs|prbs|levels|chirp|coast|identify AMPLITUDE [OFFSET PERIOD COUNT SEED]" "the same, in a binary stream";
    Stream "stream" "off|text|binary [DIVIDER]" "every DIVIDERth tick, 1..255";
    Zero "zero" "current|position" "present value is zero; disarmed";
    Clear "clear" "" "forget a trip";
    Save "save" "" "settings to EEPROM";
    Load "load" "" "from EEPROM";
    Defaults "defaults" "" "settings as built";
    Echo "echo" "off|on" "repeat input";
    Version "version" "" "firmware, settings";
    Help "help" "" "the commands; settings: show";
}
