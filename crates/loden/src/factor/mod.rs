//! Matrix factorisations and the kernels below them.
