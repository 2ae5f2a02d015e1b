//! Gains for a sketch of one's own, as text and as JSON.

use motorbench_design::Bench;
use motorbench_design::own_loop::{Asked, OwnLoop, OwnLoopError, Sketch, own_loop};
use motorbench_design::own_position_loop::{OwnPositionLoop, own_position_loop};
use motorbench_model::Model;
use motorbench_text::terminal_text::{rounded, short, wrapped};

/// The gains that were found.
pub enum Found {
    Speed(OwnLoop),
    Position(OwnPositionLoop),
}

impl Found {
    /// Finds the gains.
    pub fn new(model: &Model, bench: &Bench, asked: &Asked, position: bool) -> Result<Self, OwnLoopError> {
        match position {
            true => own_position_loop(model, bench, asked).map(Self::Position),
            false => own_loop(model, bench, asked).map(Self::Speed),
        }
    }

    /// All figures, and the code.
    pub fn json(&self) -> serde_json::Value {
        match self {
            Self::Speed(found) => serde_json::json!({ "sketch": found, "code": found.code() }),
            Self::Position(found) => serde_json::json!({ "sketch": found, "code": found.code() }),
        }
    }

    /// The text for a person.
    pub fn page(&self, asked: &Asked) -> String {
        match self {
            Self::Speed(found) => speed_page(found, asked),
            Self::Position(found) => position_page(found, asked),
        }
    }
}

fn of_value(name: &str, value: f64, unit: &str) -> String {
    format!("  {name:30} {:>10} {unit}\n", rounded(value, 4))
}

/// What is said if the loop is slower than asked for.
fn slower(bandwidth_hz: f64, asked: &Asked) -> String {
    if bandwidth_hz >= 0.99 * asked.bandwidth_hz {
        return String::new();
    }
    let slower = format!(
        "That is slower than the {} Hz asked for: at this sample time, with this motor, a faster loop has no margin. A shorter --sketch-ms, or finer counts, allow more.",
        short(asked.bandwidth_hz)
    );
    wrapped(&slower, "  ", "  ")
}

fn of_sketch(sketch: Sketch) -> &'static str {
    match sketch {
        Sketch::Library => "PID library, QuickPID",
        Sketch::Plain => "plain sketch",
    }
}

const QUICK_PID: &str =
    "QuickPID: the same gains, with pOnError, dOnMeas and iAwClamp; its SetSampleTimeUs takes microseconds.";

fn speed_page(found: &OwnLoop, asked: &Asked) -> String {
    let OwnLoop { sample_s, kp, ki, kff, kaff, loop_s, dead_band: [forward, reverse], count_rpm, bandwidth_hz, .. } =
        found;
    let sample_ms = 1e3 * sample_s;
    let mut text = format!("Speed PI for a sketch, every {sample_ms:.0} ms: bandwidth {bandwidth_hz:.2} Hz\n");
    text += &slower(*bandwidth_hz, asked);
    text += &of_value("kp", *kp, "PWM per rpm");
    text += &of_value("ki", *ki, "PWM per rpm and s");
    text += &of_value("kd", 0.0, "it would gain little");
    text += &of_value("feed-forward", *kff, "PWM per rpm");
    text += &of_value("feed-forward, acceleration", *kaff, "PWM per rpm/s");
    text += &of_value("filter of the reference", 1e3 * loop_s, "ms");
    text += &of_value("dead band forward", *forward, "PWM");
    text += &of_value("dead band reverse", *reverse, "PWM");
    text += &of_value("one count in a sample time", *count_rpm, "rpm");
    text += "\nTried in simulation, steps of the speed both ways, with all effects of the\nmodel; then with the motor's constants 30 % off\n";
    for tried in &found.tried {
        text += &format!(
            "  {:22} overshoot {:.1} %, error {:.1} rpm; 30 % off: {:.1} %\n",
            of_sketch(tried.sketch),
            tried.overshoot_percent,
            tried.error_rpm,
            tried.overshoot_when_off_percent
        );
    }
    let library = format!(
        "PID library: PID pid(&rpm, &out, &target, {kp:.5}, {ki:.5}, 0, DIRECT); pid.SetSampleTime({sample_ms:.0}); pid.SetOutputLimits(-255, 255). The target is that of the sketch below, and the bridge gets its output plus what is ahead, limited to -255..255."
    );
    text + "\n" + &wrapped(&library, "", "  ") + &wrapped(QUICK_PID, "", "  ") + "\nPlain sketch\n\n" + &found.code()
}

fn position_page(found: &OwnPositionLoop, asked: &Asked) -> String {
    let OwnPositionLoop { sample_s, kp, ki, kd, kff, friction: [forward, reverse], bandwidth_hz, .. } = found;
    let sample_ms = 1e3 * sample_s;
    let mut text = format!("Position PID for a sketch, every {sample_ms:.0} ms: bandwidth {bandwidth_hz:.2} Hz\n");
    text += &slower(*bandwidth_hz, asked);
    text += &of_value("kp", *kp, "PWM per deg");
    text += &of_value("ki", *ki, "PWM per deg and s");
    text += &of_value("kd", *kd, "PWM per deg/s");
    text += &of_value("filter of the derivative", 1e3 * found.derivative_filter_s, "ms");
    text += &of_value("feed-forward", *kff, "PWM per deg/s");
    text += &of_value("feed-forward, acceleration", found.kaff, "PWM per deg/s^2");
    text += &of_value("filter of the target, twice", 1e3 * found.loop_s, "ms");
    text += &of_value("greatest speed of the target", found.most_deg_per_s, "deg/s");
    text += &of_value("greatest acceleration", found.most_deg_per_s2, "deg/s^2");
    text += &of_value("friction forward", *forward, "PWM");
    text += &of_value("friction reverse", *reverse, "PWM");
    text += &of_value("drop of the bridge", found.drop, "PWM");
    text += &of_value("one count", found.count_deg, "deg");
    text += "\nTried in simulation, steps of 20 to 290 deg both ways, with all effects of the\nmodel; then with the motor's constants 30 % off\n";
    for tried in &found.tried {
        text += &format!(
            "  {:22} overshoot {:.1}, error {:.1} deg; 30 % off: {:.1}, {:.1} deg\n",
            of_sketch(tried.sketch),
            tried.overshoot_deg,
            tried.error_deg,
            tried.overshoot_when_off_deg,
            tried.error_when_off_deg
        );
    }
    let library = format!(
        "PID library: PID pid(&at, &out, &target, {kp:.5}, {ki:.5}, {kd:.6}, DIRECT); pid.SetSampleTime({sample_ms:.0}); pid.SetOutputLimits(-255, 255). Its derivative has no filter and acts on the position alone. So the target is that of the sketch below, and the bridge gets the output plus what is ahead plus KD * targetSpeed, limited to -255..255, and 0 at rest."
    );
    text + "\n" + &wrapped(&library, "", "  ") + &wrapped(QUICK_PID, "", "  ") + "\nPlain sketch\n\n" + &found.code()
}
