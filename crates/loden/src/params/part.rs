//! The table of a parameter struct, assembled at compile time.

use super::{Kind, Param, Type};

/// The parameters that a field of [`params!`](crate::params!) adds to the table: one, or those of a group.
#[derive(Clone, Copy)]
pub struct Part {
    ty: Type,
    param: Param,
    range: Option<[f64; 2]>,
    default: Option<&'static str>,
    is_shared: bool,
}

impl Part {
    /// Creates the part for a field `name` of type `ty`.
    pub const fn new(ty: Type, unset: Option<&'static str>, name: &'static str) -> Self {
        let param = Param { name, unit: "", kind: Kind::Switch, default: "", doc: "" };
        Self { ty, param, range: None, default: unset, is_shared: false }
    }

    /// Sets the documentation.
    pub const fn doc(mut self, doc: &'static str) -> Self {
        self.param.doc = doc.trim_ascii();
        self
    }

    /// Sets the range.
    pub const fn range(mut self, min: f64, max: f64) -> Self {
        self.range = Some([min, max]);
        self
    }

    /// Sets the unit.
    pub const fn unit(mut self, unit: &'static str) -> Self {
        self.param.unit = unit;
        self
    }

    /// Sets the default.
    pub const fn default(mut self, default: &'static str) -> Self {
        self.default = Some(default);
        self
    }

    /// The parameters.
    pub const fn params(&self) -> &[Param] {
        match self.ty {
            Type::Group(params) => params,
            _ => std::slice::from_ref(&self.param),
        }
    }

    /// Fills in kind and default.
    pub const fn finish(mut self) -> Self {
        if self.is_shared {
            return self;
        }
        let [min, max] = match self.range {
            Some(range) => range,
            None => [f64::MIN, f64::MAX],
        };
        self.param.kind = match self.ty {
            // a conversion to i64 saturates
            Type::Integer => Kind::Integer { min: min as i64, max: max as i64 },
            Type::Real => Kind::Real { min, max },
            Type::Color => Kind::Color { min, max },
            Type::Choice(words) => Kind::Choice(words),
            Type::Switch => Kind::Switch,
            Type::Text(form) => Kind::Text(form),
            Type::Group(_) => return self,
        };
        self.param.default = match self.default {
            Some(default) => default,
            None => panic!("a parameter of this type needs a default"),
        };
        self
    }

    /// Copies the parameter `shared`, except for documentation and default where the field has its own.
    pub const fn shared(mut self, shared: Param) -> Self {
        assert!(same(self.param.name, shared.name), "the field and the shared parameter have different names");
        let fits = matches!(
            (self.ty, shared.kind),
            (Type::Integer, Kind::Integer { .. })
                | (Type::Real, Kind::Real { .. })
                | (Type::Color, Kind::Color { .. })
                | (Type::Choice(_), Kind::Choice(_))
                | (Type::Switch, Kind::Switch)
                | (Type::Text(_), Kind::Text(_))
        );
        assert!(fits, "the field and the shared parameter have different types");
        let doc = if self.param.doc.is_empty() { shared.doc } else { self.param.doc };
        let default = match self.default {
            Some(default) => default,
            None => shared.default,
        };
        self.param = Param { doc, default, ..shared };
        self.is_shared = true;
        self
    }
}

const fn same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut i = 0;
    while i < a.len() && i < b.len() && a[i] == b[i] {
        i += 1;
    }
    i == a.len() && i == b.len()
}

/// The total number of parameters of the parts.
pub const fn length(parts: &[Part]) -> usize {
    let (mut count, mut i) = (0, 0);
    while i < parts.len() {
        count += parts[i].params().len();
        i += 1;
    }
    count
}

/// The parameters of all parts, concatenated.
pub const fn flatten<const N: usize>(parts: &[Part]) -> [Param; N] {
    let mut all = [Param { name: "", unit: "", kind: Kind::Switch, default: "", doc: "" }; N];
    let (mut count, mut i) = (0, 0);
    while i < parts.len() {
        let params = parts[i].params();
        let mut k = 0;
        while k < params.len() {
            all[count] = params[k];
            (count, k) = (count + 1, k + 1);
        }
        i += 1;
    }
    all
}

/// The name of a field's parameter: `alpha-x` of `alpha_x`.
#[doc(hidden)]
#[macro_export]
macro_rules! parameter_name {
    ($field:ident) => {{
        const BYTES: &[u8] = &$crate::params::kebab::<{ stringify!($field).len() }>(stringify!($field));
        const NAME: &str = match str::from_utf8(BYTES) {
            Ok(name) => name,
            Err(_) => panic!("a name is UTF-8"),
        };
        NAME
    }};
}

/// A field's name with dashes, in UTF-8.
pub const fn kebab<const N: usize>(field: &str) -> [u8; N] {
    let mut name = [0; N];
    let mut i = 0;
    while i < N {
        let byte = field.as_bytes()[i];
        name[i] = if byte == b'_' { b'-' } else { byte };
        i += 1;
    }
    name
}
