//! The hidden effect, compared with the diagnosis.

use super::row;
use maud::{Markup, html};
use motorbench_model::Model;
use motorbench_report::web_page::{code, table, text};
use motorbench_text::terminal_text::short;

const HEADING: &str = "What was hidden, and what was found";
const COLUMNS: [&str; 2] = ["hidden", "found"];

/// All constants that were hidden or found, those of effects first.
pub(super) struct Revealed(Vec<Constant>);

/// A constant that was hidden, or found.
struct Constant {
    /// Its effect; empty for the motor's own.
    effect: &'static str,
    name: &'static str,
    hidden: Option<f64>,
    found: Option<f64>,
}

impl Constant {
    /// Error relative to the hidden value.
    fn relative_error(&self) -> f64 {
        self.hidden.zip(self.found).map_or(f64::INFINITY, |(hidden, found)| (found / hidden - 1.0).abs())
    }

    fn row(&self, what: &str) -> String {
        row(&format!("  {what}"), [self.hidden, self.found].map(value_or_dash).each_ref().map(String::as_str))
    }
}

impl Revealed {
    /// Compares the hidden model with the one that was found.
    pub(super) fn of(hidden: &Model, found: &Model) -> Self {
        let [hidden, found] = [hidden, found].map(constants);
        let value = |of: &[(Name, f64)], name| of.iter().find(|(other, _)| *other == name).map(|(_, value)| *value);
        let only_found = found.iter().filter(|(name, _)| value(&hidden, *name).is_none());
        let all = hidden.iter().chain(only_found).map(|(whole @ (effect, name), _)| Constant {
            effect,
            name,
            hidden: value(&hidden, *whole),
            found: value(&found, *whole),
        });
        let mut all: Vec<Constant> = all.collect();
        all.sort_by_key(|constant| constant.effect.is_empty());
        Self(all)
    }

    /// For a terminal: every constant of an effect, and the motor's constant with the largest error.
    pub(super) fn text(&self) -> String {
        let (motor, effects): (Vec<&Constant>, Vec<&Constant>) =
            self.0.iter().partition(|constant| constant.effect.is_empty());
        let farthest = motor.into_iter().max_by(|one, other| one.relative_error().total_cmp(&other.relative_error()));
        let effects =
            effects.into_iter().map(|constant| constant.row(&format!("{} {}", constant.effect, constant.name)));
        let farthest =
            farthest.map(|constant| constant.row(&format!("of the motor, largest error: {}", constant.name)));
        row(HEADING, COLUMNS) + &effects.chain(farthest).collect::<String>()
    }

    /// For the page.
    pub(super) fn html(&self) -> Markup {
        let rows = self.0.iter().map(|Constant { effect, name, hidden, found }| {
            let name = html! { @if !effect.is_empty() { (code([*effect])) " " } (code([*name])) };
            [name, text(value_or_dash(*hidden)), text(value_or_dash(*found))]
        });
        html! { section { h2 { (HEADING) } (table(&["", COLUMNS[0], COLUMNS[1]], rows)) } }
    }
}

/// Name of a constant: its effect, and its own name.
type Name = (&'static str, &'static str);

fn constants(model: &Model) -> Vec<(Name, f64)> {
    let effects = model
        .terms
        .iter()
        .flat_map(|term| term.without_defaults().map(|(_, parameter, value)| ((term.id(), parameter.name), value)));
    effects.chain(model.motor.named().map(|(name, value)| (("", name), value))).collect()
}

/// A number, or a dash.
fn value_or_dash(value: Option<f64>) -> String {
    value.map_or("-".into(), short)
}

#[cfg(test)]
mod tests {
    use super::*;
    use motorbench_model::catalogue::effect;
    use motorbench_model::motor::MotorParameters;

    #[test]
    fn what_was_missed_and_what_was_not_there_are_revealed_too() {
        let linear = Model::linear(MotorParameters::PIVT6);
        let known = |id: &str| effect(id).expect("of the catalogue");
        let truth = linear.clone().with(known("voltage_drop"), vec![1.5]);
        let mut found = linear.with(known("coulomb_friction"), vec![0.01]);
        found.motor.inductance_h *= 0.9;
        found.motor.resistance_ohm *= 1.02;
        let text = Revealed::of(&truth, &found).text();
        let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split_whitespace().collect()).collect();
        assert!(rows[0].ends_with(&COLUMNS), "{text}");
        assert_eq!(rows[1], ["voltage_drop", "drop_V", "1.50", "-"]);
        assert_eq!(rows[2], ["coulomb_friction", "torque_Nm", "-", "0.0100"]);
        assert!(rows.len() == 4 && rows[3].contains(&"inductance_H"), "{text}");
        assert!(text.lines().all(|line| line.len() <= motorbench_text::terminal_text::COLUMNS), "{text}");
    }
}
