//! Parameters declared once: one table drives command-line flags, stored metadata and reference pages.

use std::collections::BTreeMap;

use crate::{Error, Result};

/// What a parameter may hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// A whole number in an inclusive range.
    Integer {
        /// Smallest value.
        min: i64,
        /// Largest value.
        max: i64,
    },
    /// A real number in an inclusive range.
    Real {
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
    },
    /// Three real numbers, red, green and blue, each in an inclusive range; one number stands for all three.
    Color {
        /// Smallest value of a channel.
        min: f64,
        /// Largest value of a channel.
        max: f64,
    },
    /// One of several words.
    Choice(&'static [&'static str]),
}

/// One parameter of a codec, sample or model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Param {
    /// The user's word: the command-line flag without its dashes, the key in stored metadata.
    pub name: &'static str,
    /// The unit, empty if none.
    pub unit: &'static str,
    /// Type and range.
    pub kind: Kind,
    /// The default as a user would write it.
    pub default: &'static str,
    /// One sentence.
    pub doc: &'static str,
}

impl Param {
    /// Checks that `text` is a value of this parameter.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the parameter, what was found and what is allowed.
    pub fn check(&self, text: &str) -> Result<()> {
        let wrong = |expected: String| Error::parameter(self.name, format!("found {text:?}, expected {expected}"));
        match self.kind {
            Kind::Integer { min, max } => match text.parse::<i64>() {
                Ok(value) if (min..=max).contains(&value) => Ok(()),
                _ => Err(wrong(format!("a whole number from {min} to {max}"))),
            },
            Kind::Real { min, max } => match text.parse::<f64>() {
                Ok(value) if (min..=max).contains(&value) => Ok(()),
                _ => Err(wrong(format!("a number from {min} to {max}"))),
            },
            Kind::Color { min, max } => match color(text) {
                Some(rgb) if rgb.iter().all(|v| (min..=max).contains(v)) => Ok(()),
                _ => Err(wrong(format!("one number or three with commas, each from {min} to {max}"))),
            },
            Kind::Choice(words) if words.contains(&text) => Ok(()),
            Kind::Choice(words) => Err(wrong(format!("one of {}", words.join(", ")))),
        }
    }
}

/// One number, or three with commas.
fn color(text: &str) -> Option<[f64; 3]> {
    let numbers = text.split(',').map(|part| part.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
    match numbers[..] {
        [grey] => Some([grey; 3]),
        [red, green, blue] => Some([red, green, blue]),
        _ => None,
    }
}

/// Checked values for a table of parameters; what is not given has its default.
#[derive(Debug, Clone, PartialEq)]
pub struct Values {
    table: &'static [Param],
    given: BTreeMap<String, String>,
}

impl Values {
    /// All defaults of `table`.
    pub fn defaults(table: &'static [Param]) -> Self {
        Self { table, given: BTreeMap::new() }
    }

    /// The defaults of `table`, overridden by `given` (name, value as text).
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown name or a value out of range.
    pub fn new<'a>(table: &'static [Param], given: impl IntoIterator<Item = (&'a str, &'a str)>) -> Result<Self> {
        let mut values = Self::defaults(table);
        for (name, text) in given {
            values.set(name, text)?;
        }
        Ok(values)
    }

    /// Sets one value.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown name or a value out of range.
    pub fn set(&mut self, name: &str, text: &str) -> Result<()> {
        let known = || self.table.iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
        let param = self
            .table
            .iter()
            .find(|p| p.name == name)
            .ok_or_else(|| Error::parameter(name, format!("no such parameter; there are: {}", known())))?;
        param.check(text)?;
        self.given.insert(name.into(), text.into());
        Ok(())
    }

    /// Whether `name` was set, be it to its default.
    pub fn is_given(&self, name: &str) -> bool {
        self.given.contains_key(name)
    }

    /// The value of `name` as text.
    ///
    /// # Panics
    /// If `name` is not in the table: the table is the program's own.
    pub fn text(&self, name: &str) -> &str {
        let param = self.table.iter().find(|p| p.name == name);
        let param = param.unwrap_or_else(|| panic!("no parameter {name} in the table"));
        self.given.get(name).map_or(param.default, String::as_str)
    }

    /// The value of an integer parameter.
    ///
    /// # Panics
    /// If `name` is not an integer of the table.
    pub fn integer(&self, name: &str) -> i64 {
        self.text(name).parse().unwrap_or_else(|_| panic!("parameter {name} is not an integer"))
    }

    /// The value of a real parameter.
    ///
    /// # Panics
    /// If `name` is not a number of the table.
    pub fn real(&self, name: &str) -> f64 {
        self.text(name).parse().unwrap_or_else(|_| panic!("parameter {name} is not a number"))
    }

    /// Red, green and blue of a colour parameter.
    ///
    /// # Panics
    /// If `name` is not a colour of the table.
    pub fn color(&self, name: &str) -> [f64; 3] {
        color(self.text(name)).unwrap_or_else(|| panic!("parameter {name} is not a colour"))
    }

    /// The table these are the values of.
    pub fn table(&self) -> &'static [Param] {
        self.table
    }

    /// All names with their values, in the table's order.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &str)> {
        self.table.iter().map(|p| (p.name, self.text(p.name)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &[Param] = &[
        Param { name: "components", unit: "", kind: Kind::Integer { min: 1, max: 9 }, default: "4", doc: "" },
        Param { name: "precision", unit: "", kind: Kind::Choice(&["f32", "f16"]), default: "f32", doc: "" },
    ];

    #[test]
    fn defaults_are_valid_and_overridable() {
        let values = Values::new(TABLE, [("components", "7")]).unwrap();
        assert_eq!((values.integer("components"), values.text("precision")), (7, "f32"));
    }

    #[test]
    fn a_colour_is_one_number_or_three() {
        const KIND: Kind = Kind::Color { min: 0.0, max: 1.0 };
        let table: &'static [Param] = &[Param { name: "kd", unit: "", kind: KIND, default: "0.5", doc: "" }];
        assert_eq!(Values::defaults(table).color("kd"), [0.5; 3]);
        assert_eq!(Values::new(table, [("kd", "0.1, 0.2,1")]).unwrap().color("kd"), [0.1, 0.2, 1.0]);
        for wrong in ["0.1,0.2", "0,0,1.1", "", "NaN", "red"] {
            assert!(Values::new(table, [("kd", wrong)]).is_err(), "{wrong}");
        }
    }

    #[test]
    fn errors_name_parameter_value_and_range() {
        let error = Values::new(TABLE, [("components", "10")]).unwrap_err().to_string();
        assert_eq!(error, "components: found \"10\", expected a whole number from 1 to 9");
        let error = Values::new(TABLE, [("colour", "1")]).unwrap_err().to_string();
        assert_eq!(error, "colour: no such parameter; there are: components, precision");
    }
}
