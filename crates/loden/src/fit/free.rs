//! The free parameters of a fit as plain numbers.

use super::Options;
use super::search::{Variable, tie, variables};
use crate::Result;
use crate::model::Model;
use crate::params::{Field, Kind, Value, Values};

/// The parameters of a model that a fit varies: first those searched for, then red, green and blue of each colour.
pub struct Free {
    model: &'static dyn Model,
    fixed: Values,
    variables: Vec<Variable>,
    ties: Vec<(&'static str, &'static str)>,
    colors: Vec<(&'static str, f64)>,
}

/// What the numbers of [`Free`] are.
#[cfg(feature = "renderers")]
pub(crate) struct Layout {
    /// Name, minimum and maximum of those that are searched for.
    pub numbers: Vec<(&'static str, f64, f64)>,
    /// Parameters that equal another one.
    pub ties: Vec<(&'static str, &'static str)>,
    /// Name and maximum of the colours, three numbers each.
    pub colors: Vec<(&'static str, f64)>,
}

impl Free {
    /// The free parameters of a fit with these options.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if the model does not have that many lobes.
    pub fn new(model: &'static dyn Model, options: &Options) -> Result<Self> {
        let mut fixed = Values::defaults(model.params());
        if model.params().iter().any(|param| param.name == "lobes") {
            options.lobes.write("lobes", &mut fixed)?;
        }
        let ties = if options.anisotropic { Vec::new() } else { model.ties().to_vec() };
        let variables = variables(model, &fixed, &ties, options.lobes);
        let count = model.shape(&fixed)?.count();
        let most = |name: &&'static str| match model.params().iter().find(|p| p.name == *name).map(|p| p.kind) {
            Some(Kind::Color { max, .. }) => (*name, max),
            _ => (*name, 1.0),
        };
        let colors = model.colors().iter().take(count).map(most).collect();
        Ok(Self { model, fixed, variables, ties, colors })
    }

    /// Count of the free parameters as plain numbers.
    pub fn count(&self) -> usize {
        self.variables.len() + 3 * self.colors.len()
    }

    /// The names of the numbers, in order.
    #[cfg(feature = "renderers")]
    pub(crate) fn layout(&self) -> Layout {
        Layout {
            numbers: self.variables.iter().map(|variable| (variable.name, variable.min, variable.max)).collect(),
            ties: self.ties.clone(),
            colors: self.colors.clone(),
        }
    }

    /// Extracts the free parameters from the result of a fit.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if `values` do not belong to the model's table.
    pub fn numbers(&self, values: &Values) -> Result<Vec<f32>> {
        let mut numbers = self.variables.iter().map(|v| v.read(self.model, values)).collect::<Result<Vec<f64>>>()?;
        for (name, _) in &self.colors {
            numbers.extend(values.get::<[f64; 3]>(name)?);
        }
        Ok(numbers.into_iter().map(|v| v as f32).collect())
    }

    /// The parameters with these numbers, clamped to their bounds.
    ///
    /// # Errors
    /// [`crate::Error::Parameter`] if a number is not finite.
    ///
    /// # Panics
    /// If there are fewer than [`Free::count`] numbers.
    pub fn values(&self, numbers: &[f32]) -> Result<Values> {
        let mut values = self.fixed.clone();
        let (shape, colors) = numbers.split_at(self.variables.len());
        for (variable, &number) in self.variables.iter().zip(shape) {
            values.set_value(variable.name, Value::Real(f64::from(number).clamp(variable.min, variable.max)))?;
        }
        tie(&mut values, &self.ties)?;
        for ((name, most), rgb) in self.colors.iter().zip(colors.chunks_exact(3)) {
            values.set_value(name, Value::Color([0, 1, 2].map(|c| f64::from(rgb[c]).clamp(0.0, *most))))?;
        }
        Ok(values)
    }
}
