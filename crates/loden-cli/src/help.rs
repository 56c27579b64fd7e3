//! The parameters of each method in a help page, with their own range, default and sentence.

use std::fmt::Write;

use clap::builder::styling::Style;
use clap::{Arg, ArgAction, Command};
use loden::params::{Kind, Param};

use crate::choice::Suggestions;

/// The width of help pages, at most.
pub const WIDTH: usize = 110;

/// The parameters of one method.
pub struct Section {
    /// The method's name, by which the section is chosen; empty for parameters of all methods.
    pub name: &'static str,
    /// The heading.
    pub title: String,
    /// The parameters.
    pub params: &'static [Param],
}

/// The end of a help page: the sections, then examples. If the command line names some of the methods, as in
/// `--method klt --help`, only their sections are shown.
pub fn epilogue(sections: &[Section], examples: &[&str]) -> String {
    let words: Vec<String> = std::env::args().collect();
    let named = |section: &&Section| words.iter().any(|word| word.rsplit('=').next() == Some(section.name));
    let some = sections.iter().any(|section| named(&section));
    let bold = Style::new().bold().underline();
    let mut text = String::new();
    for section in sections.iter().filter(|section| !some || section.name.is_empty() || named(section)) {
        // writing to a string cannot fail
        let _ = writeln!(text, "{bold}{}:{bold:#}\n{}\n", section.title, list(section.params));
    }
    let _ = write!(text, "{bold}Examples:{bold:#}");
    for example in examples {
        let _ = write!(text, "\n  {example}");
    }
    text
}

/// A list as of the options of a command.
fn list(params: &[Param]) -> String {
    if params.is_empty() {
        return "  (none)".into();
    }
    let command = Command::new("parameters").disable_help_flag(true).max_term_width(WIDTH).help_template("{options}");
    let text = command.args(params.iter().map(option)).render_help().ansi().to_string();
    text.trim_end().to_owned()
}

/// A parameter as an option that states its range and default.
pub fn option(param: &Param) -> Arg {
    let mut help = param.doc.trim_end_matches('.').to_owned();
    if !param.unit.is_empty() {
        help += &format!(" ({})", param.unit);
    }
    match param.kind {
        Kind::Color { min, max } => help += &format!("; one number, or three with commas, each {min}..{max}"),
        Kind::Text(form) => help += &format!(": {}", form.expected),
        _ => {}
    }
    if !param.is_optional() && param.kind != Kind::Switch {
        help += &format!(" [default: {}]", param.default);
    }
    bare(param).help(help)
}

/// A parameter as an option without help.
pub fn bare(param: &Param) -> Arg {
    let arg = Arg::new(param.name).long(param.name);
    match param.kind {
        Kind::Integer { min, max } => arg.value_name(format!("{min}..{max}")).allow_negative_numbers(true),
        Kind::Real { min, max } => arg.value_name(format!("{min}..{max}")).allow_negative_numbers(true),
        Kind::Color { .. } => arg.value_name("R,G,B"),
        Kind::Choice(words) => arg.value_name("WORD").value_parser(Suggestions(words.to_vec())),
        Kind::Switch => arg.action(ArgAction::Set).num_args(0).default_missing_value("yes"),
        Kind::Text(form) if form.examples.is_empty() => arg.value_name("TEXT"),
        Kind::Text(form) => {
            arg.value_name("TEXT").value_parser(Suggestions(form.examples.to_vec())).hide_possible_values(true)
        }
    }
}
