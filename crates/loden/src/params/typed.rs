//! Structs whose fields are parameters.

use super::{Form, Param, Value, Values};
use crate::{Error, Result};

/// A struct of parameters, made by [`params!`](crate::params!).
pub trait Params: Sized {
    /// Its parameters, in the order of its fields.
    const TABLE: &'static [Param];

    /// Reads the struct from values.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the table of `values` lacks a parameter, or gives it another type.
    fn from_values(values: &Values) -> Result<Self>;

    /// Converts the struct to values.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming a field that is out of range.
    fn to_values(&self) -> Result<Values>;

    /// Checks the range of every field, for structs that were not read from [`Values`].
    ///
    /// # Errors
    /// As [`Params::to_values`].
    fn check(&self) -> Result<()> {
        self.to_values().map(drop)
    }
}

/// Declares a struct of parameters and its table: an implementation of [`Params`], [`Default`], `Debug`, `Clone` and
/// `PartialEq`.
///
/// A field is `name: Type [range, "unit"] = default`. Its documentation is the help text; `alpha_x` is called `alpha-x` on
/// the command line. Types are those of [`Field`]: whole and real numbers, `[f64; 3]` for colours, enums made by
/// [`words!`](crate::words!), `bool` for a switch that is off by default, and `Option` for what has no default. Only
/// numbers have a range. A default is text or a number, as the user would write it.
///
/// A parameter that several structs share is a constant [`Param`]: `name: Type => PARAM`. Several that are always used
/// together are a struct of parameters themselves, used as the type of a field.
///
/// See the page of [`params`](mod@crate::params) for an example.
#[macro_export]
macro_rules! params {
    (
        $(#[$meta:meta])*
        $vis:vis struct $Name:ident {
            $(
                $(#[doc = $doc:literal])*
                $field_vis:vis $field:ident : $Type:ty
                $([$range:expr $(, $unit:literal)?])?
                $(= $default:literal)?
                $(=> $shared:expr)?
            ),* $(,)?
        }
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq)]
        $vis struct $Name {
            $($(#[doc = $doc])* $field_vis $field: $Type,)*
        }

        impl $crate::params::Params for $Name {
            const TABLE: &'static [$crate::params::Param] = {
                use $crate::params::{Field, Part, name};
                const PARTS: &[Part] = &[$({
                    const PART: Part = Part::new(<$Type as Field>::TYPE, <$Type as Field>::UNSET, name!($field))
                        .doc(concat!($($doc),*))
                        $(.range(*$range.start() as f64, *$range.end() as f64)$(.unit($unit))?)?
                        $(.default(concat!($default)))?
                        $(.shared($shared))?
                        .finish();
                    PART
                }),*];
                &$crate::params::flatten::<{ $crate::params::length(PARTS) }>(PARTS)
            };

            fn from_values(values: &$crate::params::Values) -> $crate::Result<Self> {
                $(let $field = values.get($crate::params::name!($field))?;)*
                Ok(Self { $($field),* })
            }

            fn to_values(&self) -> $crate::Result<$crate::params::Values> {
                #[allow(unused_mut)]
                let mut values = $crate::params::Values::defaults(Self::TABLE);
                $($crate::params::Field::write(&self.$field, $crate::params::name!($field), &mut values)?;)*
                Ok(values)
            }
        }

        impl Default for $Name {
            fn default() -> Self {
                use $crate::params::{Params, Values};
                Self::from_values(&Values::defaults(Self::TABLE)).expect("defaults are of the fields' types")
            }
        }

        impl $crate::params::Field for $Name {
            const TYPE: $crate::params::Type =
                $crate::params::Type::Group(<Self as $crate::params::Params>::TABLE);

            fn read(values: &$crate::params::Values, _name: &str) -> $crate::Result<Self> {
                $crate::params::Params::from_values(values)
            }

            fn write(&self, _name: &str, values: &mut $crate::params::Values) -> $crate::Result<()> {
                for (name, text) in $crate::params::Params::to_values(self)?.iter().filter(|(_, text)| !text.is_empty()) {
                    values.set(name, text)?;
                }
                Ok(())
            }
        }
    };
}

/// Declares an enum whose variants are the words of a [choice](crate::params::Kind::Choice): `enum Form { Bounded = "bounded", Ward = "ward" }`.
/// It is a [`Field`] of [`params!`](crate::params!), and has `ALL` (every variant), `name` and `Display`.
#[macro_export]
macro_rules! words {
    (
        $(#[$meta:meta])*
        $vis:vis enum $Name:ident { $($(#[$doc:meta])* $Variant:ident = $word:literal),+ $(,)? }
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        $vis enum $Name { $(#[doc = concat!("`", $word, "`.")] $(#[$doc])* $Variant),+ }

        #[allow(dead_code)]
        impl $Name {
            /// Every variant, in the order of the declaration.
            pub const ALL: &'static [Self] = &[$(Self::$Variant),+];

            /// Name of the variant, as users write it.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$Variant => $word),+ }
            }
        }

        impl std::fmt::Display for $Name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl $crate::params::Field for $Name {
            const TYPE: $crate::params::Type = $crate::params::Type::Choice(&[$($word),+]);

            fn read(values: &$crate::params::Values, name: &str) -> $crate::Result<Self> {
                values.word(name, Self::ALL, |variant| variant.name())
            }

            fn write(&self, name: &str, values: &mut $crate::params::Values) -> $crate::Result<()> {
                values.set(name, self.name())
            }
        }
    };
}

/// The kind of a parameter, without its range.
#[derive(Clone, Copy)]
pub enum Type {
    /// A whole number.
    Integer,
    /// A real number.
    Real,
    /// Three real numbers.
    Color,
    /// One of several words.
    Choice(&'static [&'static str]),
    /// `yes` or `no`.
    Switch,
    /// See [`super::Kind::Text`].
    Text(Form),
    /// Several parameters: a struct made by [`params!`](crate::params!).
    Group(&'static [Param]),
}

/// A type of parameter.
pub trait Field: Sized {
    /// The kind of parameter that holds this type.
    const TYPE: Type;

    /// The default if a declaration has none; `None` if a declaration must have one.
    const UNSET: Option<&'static str> = None;

    /// The value of the parameter `name`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the parameter does not exist or has another type.
    fn read(values: &Values, name: &str) -> Result<Self>;

    /// Sets the parameter `name` to this value.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the parameter does not exist or the value is out of range.
    fn write(&self, name: &str, values: &mut Values) -> Result<()>;
}

/// Numbers of Rust types are read from the wide ones of [`Value`].
macro_rules! number {
    ($Type:ident, $($number:ty = $narrow:expr),+) => {$(
        impl Field for $number {
            const TYPE: Type = Type::$Type;

            fn read(values: &Values, name: &str) -> Result<Self> {
                match *values.value(name)? {
                    Value::$Type(value) => $narrow(value).ok_or_else(|| mismatch(name, stringify!($number))),
                    _ => Err(mismatch(name, stringify!($number))),
                }
            }

            fn write(&self, name: &str, values: &mut Values) -> Result<()> {
                values.set(name, &self.to_string())
            }
        }
    )+};
}
number!(Integer, u8 = whole, u16 = whole, u32 = whole, u64 = whole, usize = whole, i32 = whole, i64 = Some);
number!(Real, f32 = |value| Some(value as f32), f64 = Some);

fn whole<T: TryFrom<i64>>(value: i64) -> Option<T> {
    value.try_into().ok()
}

/// Error for a parameter that has another type in the table.
fn mismatch(name: &str, expected: &str) -> Error {
    Error::parameter(name, format!("is not of the type {expected}"))
}

impl Field for [f64; 3] {
    const TYPE: Type = Type::Color;

    fn read(values: &Values, name: &str) -> Result<Self> {
        match *values.value(name)? {
            Value::Color(rgb) => Ok(rgb),
            _ => Err(mismatch(name, "colour")),
        }
    }

    fn write(&self, name: &str, values: &mut Values) -> Result<()> {
        values.set_value(name, Value::Color(*self))
    }
}

impl Field for bool {
    const TYPE: Type = Type::Switch;
    const UNSET: Option<&'static str> = Some("no");

    fn read(values: &Values, name: &str) -> Result<Self> {
        match *values.value(name)? {
            Value::Switch(on) => Ok(on),
            _ => Err(mismatch(name, "switch")),
        }
    }

    fn write(&self, name: &str, values: &mut Values) -> Result<()> {
        values.set_value(name, Value::Switch(*self))
    }
}

impl<T: Field> Field for Option<T> {
    const TYPE: Type = T::TYPE;
    const UNSET: Option<&'static str> = Some("");

    fn read(values: &Values, name: &str) -> Result<Self> {
        if values.written(name)?.is_empty() { Ok(None) } else { T::read(values, name).map(Some) }
    }

    fn write(&self, name: &str, values: &mut Values) -> Result<()> {
        self.as_ref().map_or(Ok(()), |value| value.write(name, values))
    }
}

crate::words! {
    /// `yes` or `no`, where the command line expects a word.
    pub enum YesNo {
        /// It holds.
        Yes = "yes",
        /// It does not.
        No = "no",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Kind;

    crate::words! {
        enum Shape { Round = "round", FlatTop = "flat-top" }
    }

    crate::params! {
        struct Inner {
            /// A colour.
            tint: [f64; 3] [0.0..=1.0] = 0.5,
        }
    }

    const SHARED: Param =
        Param { name: "scale", unit: "mm", kind: Kind::Real { min: 1.0, max: 2.0 }, default: "1", doc: "A scale." };

    crate::params! {
        struct Outer {
            /// How many
            /// there are.
            count: u8 [1..=300] = 4,
            /// Bent by so much.
            bend_y: f32 [-0.5..=0.5, "degrees"] = -0.25,
            shape: Shape = "flat-top",
            inner: Inner,
            scale: f64 = 1.5 => SHARED,
            open: bool,
            limit: Option<u64> [0..=i64::MAX],
        }
    }

    #[test]
    fn the_table_is_that_of_the_fields() {
        let names: Vec<&str> = Outer::TABLE.iter().map(|param| param.name).collect();
        assert_eq!(names, ["count", "bend-y", "shape", "tint", "scale", "open", "limit"]);
        let [count, bend, ..] = Outer::TABLE else { panic!("too short") };
        assert_eq!((count.doc, count.kind), ("How many there are.", Kind::Integer { min: 1, max: 300 }));
        assert_eq!((bend.unit, bend.default, bend.kind), ("degrees", "-0.25", Kind::Real { min: -0.5, max: 0.5 }));
        assert_eq!(Outer::TABLE[4], Param { default: "1.5", ..SHARED });
        assert_eq!(Outer::TABLE[6].kind, Kind::Integer { min: 0, max: i64::MAX });
    }

    #[test]
    fn values_become_fields_and_fields_values() {
        let outer = Outer::default();
        assert_eq!(
            (outer.count, outer.bend_y, outer.shape, outer.open, outer.limit),
            (4, -0.25, Shape::FlatTop, false, None)
        );
        let given = [("shape", "round"), ("tint", "0.1,0.2,0.3"), ("open", "yes"), ("limit", "12")];
        let values = Values::new(Outer::TABLE, given).unwrap();
        let outer = Outer::from_values(&values).unwrap();
        assert_eq!((outer.shape, outer.inner.tint, outer.limit), (Shape::Round, [0.1, 0.2, 0.3], Some(12)));
        assert_eq!(Outer::from_values(&outer.to_values().unwrap()).unwrap(), outer);
        let json = serde_json::to_string(&values).unwrap();
        let expected =
            r#"{"count":4,"bend-y":-0.25,"shape":"round","tint":[0.1,0.2,0.3],"scale":1.5,"open":true,"limit":12}"#;
        assert_eq!(json, expected);
    }

    #[test]
    fn what_does_not_fit_is_an_error_that_names_the_field() {
        let error = |outer: &Outer| outer.check().unwrap_err().to_string();
        for scale in [0.5, f64::NAN, f64::INFINITY] {
            assert!(error(&Outer { scale, ..Outer::default() }).starts_with("scale: found"));
        }
        assert_eq!(
            error(&Outer { count: 0, ..Outer::default() }),
            "count: found \"0\", expected a whole number from 1 to 300"
        );
        // narrower than the table
        let values = Values::new(Outer::TABLE, [("count", "256")]).unwrap();
        assert_eq!(Outer::from_values(&values).unwrap_err().to_string(), "count: is not of the type u8");
        let other = Values::defaults(Inner::TABLE);
        assert!(Outer::from_values(&other).unwrap_err().to_string().starts_with("count: no such parameter"));
        assert!(Values::defaults(Outer::TABLE).get::<Shape>("count").is_err());
        assert!(Values::defaults(Outer::TABLE).get::<bool>("shape").is_err());
    }
}
