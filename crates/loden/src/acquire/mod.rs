//! The virtual goniometer: measured materials made by simulation.
