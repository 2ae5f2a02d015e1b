//! Every threshold and prior of the diagnosis by evidence, each with its reason.

/// See the module.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// What the laws leave out of torque and voltage, as a share of the typical torque and voltage (one standard deviation).
    /// Friction that differs from turn to turn and a voltage that is held over half a millisecond make some thousandths.
    pub laws_leave_out: f64,
    /// How long such an error lasts: about a turn of a small motor, or a time constant of its speed.
    pub correlation_s: f64,
    /// Greatest multiple of that share: beyond it nothing would be left for the model.
    pub most_left_out: f64,
    /// Degrees of freedom of Student's density. With five a row that is off by ten standard deviations costs what
    /// five at three standard deviations do.
    pub degrees_of_freedom: f64,
    /// Standard deviation of the logarithm of a sensor's noise around what its rows show by themselves.
    pub noise_spread: f64,
    /// Standard deviation of the logarithm of what the laws leave out.
    pub left_out_spread: f64,
    /// A strength is expected within so many times what the catalogue calls usual (one standard deviation).
    pub strength_spread: f64,
    /// Standard deviation of the logarithm of another positive constant around its usual value.
    pub constant_spread: f64,
    /// Logarithm of the prior odds of an effect that hardly any bench is without.
    pub usual_odds: f64,
    /// The same of any other: of some twenty, one or two are on a bench.
    pub other_odds: f64,
    /// An effect is named from this logarithm of its posterior odds on: one wrong name in some hundred recordings.
    pub named_odds: f64,
    /// Two models closer than this cannot be told apart: odds of twenty to one.
    pub same_odds: f64,
    /// So many effects are fitted at each step of the search, of those that promise most.
    pub tried: usize,
    /// Effects at most: more cannot be told apart in one recording.
    pub most_effects: usize,
    /// Another way to read the current has to be more probable by this: there are about a dozen of them.
    pub reading_odds: f64,
    /// Standard deviations of the logarithms of nominal R, L, k and J: a resistance is measured with a meter, an inductance
    /// depends on the frequency, an inertia on what is on the shaft.
    pub nominal_spread: [f64; 4],
    /// Standard deviation of the viscous friction, as a share of what the back-EMF brakes: small motors have hundredths.
    pub viscous_share: f64,
    /// Relative error of a constant (one standard deviation) that the steps of the simulation and readings at an instant make,
    /// measured on benches with known constants.
    pub motor_error: f64,
    /// Logarithm of found over nominal by which a data sheet errs without being wrong.
    pub data_sheet_tolerance: f64,
    /// A value is called wrong so many standard errors beyond that, of which each is at least the second number.
    pub beyond_tolerance_sigmas: f64,
    /// See there.
    pub least_spread: f64,
    /// By how much a drop may differ between pulse and off phase, as a share of it (one standard deviation): two transistors in
    /// the one, a transistor and a diode in the other.
    pub drop_difference: f64,
    /// A delay of less than so many rows is where in its row a command acts, and no delay.
    pub named_delay_rows: f64,
    /// Standard deviation of a delay: most are of a program, few of a slow host.
    pub delay_spread_s: f64,
    /// Standard deviation of the logarithm of a torque constant that no rig file gives, around the one with which the fastest speed
    /// takes nine tenths of the greatest voltage.
    pub back_emf_spread: f64,
    /// Of an effect with a number of periods so many numbers are tried.
    pub numbers_tried: f64,
    /// What remains has to be so many times what the laws always leave out to be called missing.
    pub missing: f64,
}

impl Settings {
    /// Those of the program.
    pub const USUAL: Self = Self {
        laws_leave_out: 0.003,
        correlation_s: 0.1,
        most_left_out: 300.0,
        degrees_of_freedom: 5.0,
        noise_spread: 0.5,
        left_out_spread: 1.5,
        strength_spread: 5.0,
        constant_spread: 1.5,
        usual_odds: 0.0,
        other_odds: -4.0,
        named_odds: 5.0,
        same_odds: 3.0,
        tried: 4,
        most_effects: 8,
        reading_odds: 5.0,
        nominal_spread: [0.1, 0.2, 0.2, 0.2],
        viscous_share: 0.05,
        motor_error: 1e-3,
        data_sheet_tolerance: 0.25,
        beyond_tolerance_sigmas: 3.0,
        least_spread: 0.02,
        drop_difference: 0.15,
        named_delay_rows: 0.5,
        delay_spread_s: 0.1,
        back_emf_spread: 0.4,
        numbers_tried: 30.0,
        missing: 6.0,
    };
}
