//! `ubo2014`: the binary `.btf` files of Bonn, factored or raw.
//!
//! # Format
//! A signature (`!DFMF08FC`, `!FMF12FCE`, `!FMF06FC`, `!PVF06FC`, `!BDIF06R2!`; an R after it announces rotations), a
//! block that describes the measurement, the directions in radians, and the size. Then follows one of: a
//! factorisation of each of three decorrelated channels (DFMF), of all channels together (FMF), or of each view
//! (PVF); or the reflectance of every texel (BDI: raw, bzip2, or only the texels of a mask). M\[light and view,
//! texel\] is the product of two matrices, whose sizes tell whether they are stored transposed.
//!
//! # Limits
//! The file is memory-mapped and decoded on demand, one image or view at a time. BDI files are stored texel by texel,
//! so every image touches the whole file, and a bzip2 file is unpacked for each. Values are linear light. A version 1
//! file does not state whether the cosine is included; by default it is. By default the first row of the file is the
//! bottom of the picture; readers differ. Spectral files are converted to linear RGB (CIE 1931 2 degree observer,
//! D65). Rotations, height maps, masks beyond the stored texels and the colour scale are ignored. PVF and BDI were
//! not tested with files of other writers.
//!
//! # References
//! schwartz2013, mueller2009

mod bdi;

mod factors;
mod header;

use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use memmap2::Mmap;

use super::{Conventions, Importer, Measured, head};
use crate::btf::{BtfMeta, BtfSource, Cosine, SampleType, Texels};
use crate::color::Encoding;
use crate::input::map;
use crate::params::{Param, Params, Values};
use crate::{Error, Result};
use bdi::Bdi;
use factors::Factors;
pub(crate) use header::SIGNATURES;
use header::{Header, Kind};

pub(super) struct Ubo2014;

crate::words! {
    enum FirstRow { Bottom = "bottom", Top = "top" }
}

crate::params! {
    struct Options {
        conventions: Conventions,
        /// Position of the first row in the file.
        first_row: FirstRow = "bottom",
    }
}

impl Importer for Ubo2014 {
    fn name(&self) -> &'static str {
        "ubo2014"
    }

    fn doc(&self) -> &'static str {
        "`.btf` files of Bonn: DFMF (UBO2014), FMF, PVF and BDI."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 16)?;
        Ok(SIGNATURES.iter().any(|(signature, _)| bytes.starts_with(signature)))
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn open(&self, path: &Path, options: &Values) -> Result<Measured> {
        let options = Options::from_values(options)?;
        Ok(Measured::Btf(Arc::new(Source::open(path, &options)?)))
    }
}

/// How the values are stored.
enum Body {
    Factors(Factors),
    Bdi(Bdi),
}

struct Source {
    path: PathBuf,
    meta: BtfMeta,
    map: Mmap,
    body: Body,
    bottom_first: bool,
    facts: Vec<(&'static str, String)>,
    warnings: Vec<String>,
}

impl Source {
    fn open(path: &Path, options: &Options) -> Result<Self> {
        let map = map(path)?;
        let (header, mut cursor) = Header::read(path, &map)?;
        // Read the body
        let (width, height, body) = match header.kind {
            Kind::Bdi => {
                let (bdi, [width, height]) = Bdi::read(&header, &mut cursor)?;
                (width, height, Body::Bdi(bdi))
            }
            kind => {
                let [width, height] = header::size(&mut cursor)?;
                header.rotations(&mut cursor)?;
                let factors = Factors::read(kind, &header, [width, height], &mut cursor)?;
                (width, height, Body::Factors(factors))
            }
        };
        if cursor.left() > 0 {
            return Err(cursor.invalid("end", format!("the file has {} bytes too many", cursor.left())));
        }
        // Determine the conventions
        let stated = header.cosine.map(|flag| if flag == 1 { Cosine::Included } else { Cosine::Excluded });
        let meta = BtfMeta {
            width,
            height,
            views: header.views.clone(),
            lights: header.lights.clone(),
            encoding: options.conventions.encoding.unwrap_or(Encoding::Linear),
            cosine: options.conventions.cosine.or(stated).unwrap_or(Cosine::Included),
            sample_type: SampleType::F32,
        };
        // Explain them
        let mut facts = header.facts.clone();
        let (asked, flag) = ("as asked for".to_owned(), "stated by the file".to_owned());
        facts.push((
            "why_encoding",
            options.conventions.encoding.map_or("the format is linear".into(), |_| asked.clone()),
        ));
        let unstated = || "not stated before version 2".to_owned();
        facts.push((
            "why_cosine",
            options.conventions.cosine.map_or_else(|| stated.map_or_else(unstated, |_| flag), |_| asked),
        ));
        let bottom_first = options.first_row == FirstRow::Bottom;
        facts.push(("first_row", if bottom_first { "bottom" } else { "top" }.into()));
        let warnings = header.warnings.clone();
        Ok(Self { path: path.into(), meta, map, body, bottom_first, facts, warnings })
    }

    fn decode(&self, view: usize, lights: Range<usize>) -> Result<Texels<'_>> {
        let (width, height, count) = (self.meta.width, self.meta.height, lights.len());
        let mut out = vec![0.0; count * self.meta.image_len()];
        let (first, mut bad) = (lights.start, None);
        // [texel of the file] -> one colour per light
        let mut put = |texel: usize, colours: &[[f32; 3]]| {
            let (x, y) = (texel % width, texel / width);
            let row = if self.bottom_first { height - 1 - y } else { y };
            for (light, colour) in colours.iter().enumerate() {
                let at = ((light * height + row) * width + x) * 3;
                out[at..at + 3].copy_from_slice(colour);
                if !colour.iter().all(|v| v.is_finite()) {
                    bad = Some(light + first);
                }
            }
        };
        match &self.body {
            Body::Factors(factors) => factors.decode(&self.map, view, lights, &mut put),
            Body::Bdi(bdi) => bdi.decode(&self.path, &self.map, view, lights, &mut put)?,
        }
        match bad {
            None => Ok(Texels::F32(Cow::Owned(out))),
            Some(light) => {
                let field = format!("view {view}, light {light}");
                Err(Error::invalid(&self.path, field, "found a decoded value that is not finite"))
            }
        }
    }
}

impl BtfSource for Source {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        self.decode(view, 0..self.meta.lights.len())
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.decode(view, light..light + 1)
    }

    fn source_bytes(&self) -> u64 {
        self.map.len() as u64
    }

    fn facts(&self) -> &[(&'static str, String)] {
        &self.facts
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
