//! Checks a value against a JSON schema, with the keywords that `docs/reference/diagnosis.schema.json` uses. Another
//! keyword is an error of the test: what nobody checks must not look checked.

use serde_json::{Map, Value};

/// Keywords that say something to a reader.
const FOR_READERS: [&str; 4] = ["$schema", "$defs", "title", "description"];

/// What of a value contradicts a schema, each with its place.
pub fn errors(schema: &Value, value: &Value) -> Vec<String> {
    let mut found = Vec::new();
    Checker { root: schema, found: &mut found }.check(schema, value, "");
    found
}

struct Checker<'a> {
    root: &'a Value,
    found: &'a mut Vec<String>,
}

impl Checker<'_> {
    fn expect(&mut self, right: bool, at: &str, wrong: impl FnOnce() -> String) {
        if !right {
            self.found.push(format!("{at}: {}", wrong()));
        }
    }

    /// Whether a value agrees with a schema, without a report.
    fn agrees(&self, schema: &Value, value: &Value) -> bool {
        let mut found = Vec::new();
        Checker { root: self.root, found: &mut found }.check(schema, value, "");
        found.is_empty()
    }

    fn check(&mut self, schema: &Value, value: &Value, at: &str) {
        let Value::Object(schema) = schema else {
            let Value::Bool(anything) = schema else { panic!("{schema} is no schema") };
            return self.expect(*anything, at, || "nothing is allowed here".into());
        };
        for (keyword, rule) in schema {
            match value {
                _ if self.check_any(keyword, rule, value, at) => {}
                Value::Object(value) if self.check_object(keyword, (rule, schema), value, at) => {}
                Value::Array(value) if self.check_array(keyword, rule, value, at) => {}
                Value::Number(value) if self.check_number(keyword, rule, value.as_f64().unwrap(), at) => {}
                Value::String(value) if keyword == "pattern" => {
                    let begins = rule.as_str().and_then(|rule| rule.strip_prefix('^')).expect("a beginning");
                    assert!(
                        begins.chars().all(|c| c.is_alphanumeric() || ":_".contains(c)),
                        "{rule}: no plain beginning"
                    );
                    self.expect(value.starts_with(begins), at, || format!("{value} does not begin with {begins}"));
                }
                _ => assert!(OF_ONE_TYPE.contains(&keyword.as_str()), "{keyword} is not checked"),
            }
        }
        if let Some(condition) = schema.get("if") {
            let then = if self.agrees(condition, value) { "then" } else { "else" };
            schema.get(then).into_iter().for_each(|rule| self.check(rule, value, at));
        }
    }

    /// Keywords about every type; false for others.
    fn check_any(&mut self, keyword: &str, rule: &Value, value: &Value, at: &str) -> bool {
        match keyword {
            "type" => {
                let types = rule.as_array().map_or(std::slice::from_ref(rule), Vec::as_slice);
                self.expect(types.iter().any(|name| is_of(value, name)), at, || format!("{value} is no {rule}"));
            }
            "const" => self.expect(value == rule, at, || format!("{value} is not {rule}")),
            "enum" => {
                let known = rule.as_array().expect("a list").contains(value);
                self.expect(known, at, || format!("{value} is none of {rule}"));
            }
            "anyOf" => {
                let agrees = rule.as_array().expect("a list").iter().any(|rule| self.agrees(rule, value));
                self.expect(agrees, at, || format!("{value} agrees with none of {rule}"));
            }
            "$ref" => {
                let place = rule.as_str().and_then(|rule| rule.strip_prefix('#')).expect("a place in the schema");
                let root = self.root;
                self.check(root.pointer(place).unwrap_or_else(|| panic!("no {rule}")), value, at);
            }
            "if" | "then" | "else" => {}
            _ => return FOR_READERS.contains(&keyword),
        }
        true
    }

    fn check_object(
        &mut self,
        keyword: &str,
        (rule, schema): (&Value, &Map<String, Value>),
        value: &Map<String, Value>,
        at: &str,
    ) -> bool {
        let names = |rule: &Value| -> Vec<String> {
            rule.as_array().expect("names").iter().map(|name| name.as_str().expect("a name").to_owned()).collect()
        };
        match keyword {
            "properties" => {
                for (name, rule) in rule.as_object().expect("properties") {
                    value.get(name).into_iter().for_each(|value| self.check(rule, value, &format!("{at}/{name}")));
                }
            }
            "additionalProperties" => {
                let listed = schema.get("properties").and_then(Value::as_object);
                for (name, value) in value.iter().filter(|(name, _)| listed.is_none_or(|all| !all.contains_key(*name)))
                {
                    self.check(rule, value, &format!("{at}/{name}"));
                }
            }
            "propertyNames" => {
                value.keys().for_each(|name| self.check(rule, &Value::from(name.as_str()), &format!("{at}/{name}")));
            }
            "required" => {
                for name in names(rule) {
                    self.expect(value.contains_key(&name), at, || format!("{name} is missing"));
                }
            }
            "dependentRequired" => {
                for (name, needs) in
                    rule.as_object().expect("names").iter().filter(|(name, _)| value.contains_key(*name))
                {
                    for needed in names(needs) {
                        self.expect(value.contains_key(&needed), at, || format!("{name} is there without {needed}"));
                    }
                }
            }
            _ => return false,
        }
        true
    }

    fn check_array(&mut self, keyword: &str, rule: &Value, value: &[Value], at: &str) -> bool {
        let bound = || rule.as_u64().expect("a number") as usize;
        match keyword {
            "items" => {
                (0..).zip(value).for_each(|(index, item): (usize, _)| self.check(rule, item, &format!("{at}/{index}")))
            }
            "minItems" => self.expect(value.len() >= bound(), at, || format!("fewer than {rule}")),
            "maxItems" => self.expect(value.len() <= bound(), at, || format!("more than {rule}")),
            _ => return false,
        }
        true
    }

    fn check_number(&mut self, keyword: &str, rule: &Value, value: f64, at: &str) -> bool {
        let bound = || rule.as_f64().expect("a number");
        match keyword {
            "minimum" => self.expect(value >= bound(), at, || format!("{value} is below {rule}")),
            "maximum" => self.expect(value <= bound(), at, || format!("{value} is above {rule}")),
            _ => return false,
        }
        true
    }
}

/// Keywords about values of one type, which say nothing about others.
const OF_ONE_TYPE: [&str; 11] = [
    "properties",
    "additionalProperties",
    "propertyNames",
    "required",
    "dependentRequired",
    "items",
    "minItems",
    "maxItems",
    "minimum",
    "maximum",
    "pattern",
];

fn is_of(value: &Value, name: &Value) -> bool {
    match name.as_str().expect("the name of a type") {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "number" => value.is_number(),
        "integer" => value.as_f64().is_some_and(|number| number.fract() == 0.0),
        "boolean" => value.is_boolean(),
        "null" => value.is_null(),
        other => panic!("{other} is no type"),
    }
}

/// Each keyword refuses what it should.
#[test]
fn every_keyword_refuses_something() {
    use serde_json::json;
    for (schema, right, wrong) in [
        (json!({ "type": ["string", "null"] }), json!(null), json!(1)),
        (json!({ "type": "integer" }), json!(2), json!(2.5)),
        (json!({ "const": 1 }), json!(1), json!(2)),
        (json!({ "enum": ["a", "b"] }), json!("a"), json!("c")),
        (json!({ "anyOf": [{ "type": "null" }, { "pattern": "^a:" }] }), json!("a:b"), json!("b")),
        (json!({ "$ref": "#/$defs/n", "$defs": { "n": { "minimum": 1 } } }), json!(1), json!(0)),
        (json!({ "maximum": 1 }), json!(1), json!(2)),
        (json!({ "properties": { "a": { "type": "null" } } }), json!({ "b": 1 }), json!({ "a": 1 })),
        (json!({ "properties": { "a": true }, "additionalProperties": false }), json!({ "a": 1 }), json!({ "b": 1 })),
        (json!({ "additionalProperties": { "type": "null" } }), json!({ "a": null }), json!({ "a": 1 })),
        (json!({ "propertyNames": { "enum": ["a"] } }), json!({ "a": 1 }), json!({ "b": 1 })),
        (json!({ "required": ["a"] }), json!({ "a": 1 }), json!({})),
        (json!({ "dependentRequired": { "a": ["b"] } }), json!({ "b": 1 }), json!({ "a": 1 })),
        (json!({ "items": { "type": "null" } }), json!([null]), json!([null, 1])),
        (json!({ "minItems": 1 }), json!([1]), json!([])),
        (json!({ "maxItems": 1 }), json!([1]), json!([1, 2])),
        (json!({ "if": { "const": 1 }, "then": true, "else": { "const": 2 } }), json!(2), json!(3)),
        (json!({ "if": { "type": "null" }, "then": false }), json!(1), json!(null)),
    ] {
        assert_eq!(errors(&schema, &right), [""; 0], "{schema}");
        assert!(!errors(&schema, &wrong).is_empty(), "{schema} allows {wrong}");
    }
}
