//! What the values of a setting are told as: all items alike, so that a column of the table has one type.

use super::rule::Vary;
use crate::sheet::text_of;
use serde_json::json;
use std::collections::BTreeMap;
use toml::Value;

/// A type that holds all values of a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Truth,
    Whole,
    Number,
    Text,
}

impl Kind {
    /// That of a value; of a list, that of all its parts.
    fn of(value: &Value) -> Kind {
        match value {
            Value::Boolean(_) => Kind::Truth,
            Value::Integer(_) => Kind::Whole,
            Value::Float(_) => Kind::Number,
            Value::Array(list) => list.iter().map(Kind::of).reduce(Kind::join).unwrap_or(Kind::Text),
            _ => Kind::Text,
        }
    }

    fn join(self, other: Kind) -> Kind {
        match (self, other) {
            (a, b) if a == b => a,
            (Kind::Whole | Kind::Number, Kind::Whole | Kind::Number) => Kind::Number,
            _ => Kind::Text,
        }
    }

    /// A value as JSON.
    pub fn json(self, value: &Value) -> serde_json::Value {
        match (value, self) {
            (Value::Array(list), _) => list.iter().map(|v| self.json(v)).collect(),
            (Value::Integer(v), Kind::Number) => json!(*v as f64),
            (Value::Integer(v), Kind::Whole) => json!(v),
            (Value::Float(v), Kind::Whole | Kind::Number) => json!(v),
            (Value::Boolean(v), Kind::Truth) => json!(v),
            (other, _) => json!(text_of(other)),
        }
    }
}

/// The kinds of all settings, by what their values may be.
pub(super) fn of_settings(vary: &[Vary]) -> BTreeMap<String, Kind> {
    let mut kinds: BTreeMap<String, Kind> = BTreeMap::new();
    for (name, value) in vary.iter().flat_map(Vary::samples).flatten() {
        let kind = Kind::of(&value);
        kinds.entry(name).and_modify(|k| *k = k.join(kind)).or_insert(kind);
    }
    kinds
}

#[cfg(test)]
mod tests {
    use super::super::Dataset;
    use serde_json::{Value, json};
    use std::path::Path;

    #[test]
    fn values_of_a_setting_have_one_type_in_all_items() {
        let told = |rule: &str| -> Vec<Value> {
            let text = format!("items = 3\n[[vary]]\n{rule}\n");
            let set = Dataset::new(&text, "spec.toml", Path::new("")).unwrap();
            let of = |item| set.parameters_json(item).unwrap()["parameters"].as_object().unwrap().values().next().cloned();
            (0..3).map(|item| of(item).unwrap()).collect()
        };
        let same = |rule: &str, texts: [&str; 3]| {
            let found: Vec<String> = told(rule).iter().map(Value::to_string).collect();
            assert_eq!(found, texts, "{rule}");
        };
        same("name = \"compensation\"\nvalues = [0.5, 1, 2]", ["0.5", "1.0", "2.0"]);
        same("name = \"iso\"\nvalues = [100, \"auto\", 400]", ["\"100\"", "\"auto\"", "\"400\""]);
        same("name = \"iso\"\nvalues = [100, 200, 400]", ["100", "200", "400"]);
        same(
            "name = \"camera.look_at\"\nvalues = [[0, 1, 2], [0, 0.5, 2], [1, 1, 1]]",
            ["[0.0,1.0,2.0]", "[0.0,0.5,2.0]", "[1.0,1.0,1.0]"],
        );
        // Of two entries of one setting, too.
        let two = "name = \"iso\"\nvalues = [100, 200, 400]\n[[vary]]\nname = \"iso\"\nrange = [100, 200]\nwhen = { iso = 400 }";
        assert!(told(two).iter().all(Value::is_f64), "{:?}", told(two));
        assert_eq!(told("name = \"frozen\"\nvalues = [true, false, true]")[0], json!(true));
    }
}
