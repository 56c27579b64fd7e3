//! Readers of measured data, one file per format.
