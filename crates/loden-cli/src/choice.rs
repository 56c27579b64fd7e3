//! Arguments that are one of several words, each with a line of help, from the library's registries.

use std::ffi::OsStr;

use clap::builder::{PossibleValue, PossibleValuesParser, StringValueParser, TypedValueParser};
use clap::{Arg, Command};
use loden::codec::{CODECS, lossless};
use loden::direction::DirectionSet;
use loden::export::{BRDF_EXPORTERS, EXPORTERS};
use loden::job::sample_kinds;
use loden::model::MODELS;
use loden::picture::ToneMap;
use loden::render::object::OBJECTS;
use loden::renderers::RENDERERS;
use loden::separable::FACTORISATIONS;
use loden::synth::SYNTHESES;

/// The word for all of something.
pub const ALL: &str = "all";

/// The word for nothing.
pub const NONE: &str = "none";

fn value((name, doc): (&'static str, &'static str)) -> PossibleValue {
    PossibleValue::new(name).help(doc.trim_end_matches('.'))
}

fn parser(choices: impl IntoIterator<Item = PossibleValue>) -> PossibleValuesParser {
    choices.into_iter().collect::<Vec<_>>().into()
}

/// One of several words that need no explanation.
pub fn words(words: impl Iterator<Item = &'static str>) -> PossibleValuesParser {
    parser(words.map(PossibleValue::new))
}

fn codecs() -> impl Iterator<Item = PossibleValue> {
    CODECS.iter().map(|codec| value((codec.name(), codec.doc())))
}

/// A compression method.
pub fn method() -> PossibleValuesParser {
    parser(codecs())
}

/// A compression method, or all of them.
pub fn methods_or_all() -> PossibleValuesParser {
    parser(codecs().chain([value((ALL, "Every method"))]))
}

/// A compression method, or none.
pub fn methods_or_none() -> PossibleValuesParser {
    parser(codecs().chain([value((NONE, "No compressed form"))]))
}

/// A lossless stage, or none.
pub fn stage() -> PossibleValuesParser {
    parser([NONE].into_iter().chain(lossless::STAGES.iter().map(|stage| stage.name)).map(PossibleValue::new))
}

/// A factorisation of BRDFs.
pub fn factorisation() -> PossibleValuesParser {
    parser(FACTORISATIONS.iter().map(|factorisation| value((factorisation.name(), factorisation.doc()))))
}

/// A renderer to export to.
pub fn renderer() -> PossibleValuesParser {
    parser(RENDERERS.iter().map(|renderer| value((renderer.name(), renderer.doc()))))
}

/// A method of synthesis.
pub fn synthesis() -> PossibleValuesParser {
    parser(SYNTHESES.iter().map(|method| value((method.name(), method.doc()))))
}

fn models() -> impl Iterator<Item = PossibleValue> {
    MODELS.iter().map(|model| value((model.name(), model.doc())))
}

/// An analytic model, with parameters behind it or without.
pub fn model() -> Suggestions {
    Suggestions(MODELS.iter().map(|model| model.name()).collect())
}

/// An analytic model, or all of them.
pub fn model_or_all() -> PossibleValuesParser {
    parser([value((ALL, "Every model"))].into_iter().chain(models()))
}

/// A sample of the virtual goniometer.
pub fn sample() -> PossibleValuesParser {
    parser(sample_kinds().into_iter().map(|kind| value((kind.name, kind.doc))))
}

/// A format that BTFs or BRDFs are written in.
pub fn format() -> PossibleValuesParser {
    let btfs = EXPORTERS.iter().map(|exporter| value((exporter.name(), exporter.doc())));
    parser(btfs.chain(BRDF_EXPORTERS.iter().map(|exporter| value((exporter.name(), exporter.doc())))))
}

/// The help of an output that is a BTF, with all formats.
pub fn btf_output(first: &str) -> String {
    let formats = EXPORTERS.iter().map(|exporter| exporter.doc());
    format!("{first}.\n\nA BTF, - for standard output:\n{}", list(formats))
}

/// The formats of a BRDF.
pub fn brdf_formats() -> String {
    list(BRDF_EXPORTERS.iter().map(|exporter| exporter.doc()))
}

fn list<'a>(lines: impl Iterator<Item = &'a str>) -> String {
    lines.map(|line| format!("- {line}")).collect::<Vec<_>>().join("\n")
}

/// A curve that maps light to a display.
pub fn tone_map() -> PossibleValuesParser {
    parser(ToneMap::ALL.iter().map(|tone| PossibleValue::new(tone.name())))
}

/// A known set of directions.
pub fn directions() -> PossibleValuesParser {
    parser(DirectionSet::names().map(PossibleValue::new))
}

/// A built-in object or a file.
pub fn object() -> Suggestions {
    Suggestions(OBJECTS.iter().map(|object| object.name).collect())
}

/// Any text; shells complete these words.
#[derive(Clone)]
pub struct Suggestions(pub Vec<&'static str>);

impl TypedValueParser for Suggestions {
    type Value = String;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<String, clap::Error> {
        StringValueParser::new().parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.0.iter().copied().map(PossibleValue::new)))
    }
}
