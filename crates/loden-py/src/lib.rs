//! The native module of the Python package `loden`.

mod arrays;
mod batches;
mod brdf;
mod btf;
mod distributed;
mod errors;
mod foreign;
mod jobs;
mod make;
mod parts;
mod work;

use pyo3::prelude::*;

/// Measured materials: BTFs and BRDFs, opened, evaluated, compressed and rendered.
#[pymodule(gil_used = false)]
fn _loden(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<btf::Btf>()?;
    module.add_class::<brdf::Brdf>()?;
    module.add_class::<batches::Batches>()?;
    module.add_function(wrap_pyfunction!(btf::open, module)?)?;
    module.add_function(wrap_pyfunction!(btf::from_numpy, module)?)?;
    module.add_function(wrap_pyfunction!(arrays::directions, module)?)?;
    module.add_function(wrap_pyfunction!(parts::store_parts, module)?)?;
    distributed::register(module)?;
    make::register(module)?;
    jobs::register(module)
}
