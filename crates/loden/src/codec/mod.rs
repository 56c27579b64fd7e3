//! Compression: one file per method, behind one interface; the stored form.
