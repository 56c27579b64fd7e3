//! Physics of the goniometer.
