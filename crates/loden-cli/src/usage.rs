//! Usage errors in sentences.

use std::io::IsTerminal;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Arg, ArgAction, Command};

use crate::terminal;

/// What libraries say about numbers, and what a person would.
const SENTENCES: [(&str, &str); 9] = [
    ("invalid digit found in string", "a whole number is expected"),
    ("cannot parse integer from empty string", "a whole number is expected"),
    ("invalid float literal", "a number is expected"),
    ("cannot parse float from empty string", "a number is expected"),
    ("number would be zero for non-zero type", "at least 1 is expected"),
    ("number too large to fit in target type", "the number is too large"),
    ("number too small to fit in target type", "the number is too small"),
    ("provided string was not `true` or `false`", "true or false is expected"),
    ("value was not a boolean", "true or false is expected"),
];

/// The command, whose options take values that begin with a minus sign, so that a wrong one is called wrong.
pub fn forgiving(command: Command) -> Command {
    let takes_value = |arg: &Arg| {
        matches!(arg.get_action(), ArgAction::Set | ArgAction::Append)
            && arg.get_num_args().is_none_or(|count| count.takes_values())
    };
    let forgiving = |arg: Arg| if takes_value(&arg) { arg.allow_negative_numbers(true) } else { arg };
    command.mut_args(forgiving).mut_subcommands(self::forgiving)
}

/// Prints a usage error, or the help that was asked for.
pub fn report(error: &clap::Error) -> ExitCode {
    if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) {
        // a reader such as `head` may close the pipe early
        let _ = error.print();
        return ExitCode::SUCCESS;
    }
    let rendered = error.render();
    let text = if std::io::stderr().is_terminal() { rendered.ansi().to_string() } else { rendered.to_string() };
    eprint!("{}", in_words(&text));
    if std::env::args_os().any(|argument| argument == "--json") {
        let text = in_words(&rendered.to_string());
        let message = text.split("\n\n").next().unwrap_or(&text);
        terminal::print_error("usage", message.trim_start_matches("error: "), None);
    }
    ExitCode::from(2)
}

fn in_words(text: &str) -> String {
    let text = SENTENCES.iter().fold(text.to_owned(), |text, (from, to)| text.replace(from, to));
    range(&text).unwrap_or(text)
}

/// A range as a person would say it, in place of `-4 is not in 0..=4294967295`.
fn range(text: &str) -> Option<String> {
    let (before, after) = text.split_once(" is not in ")?;
    let number = |c: char| !c.is_ascii_digit() && c != '-';
    let (from, rest) = after.split_once("..=")?;
    let (to, rest) = rest.split_at(rest.find(number).unwrap_or(rest.len()));
    let known = ["255", "65535", "4294967295", "18446744073709551615"].contains(&to);
    let expected = if known { format!("at least {from}") } else { format!("{from} to {to}") };
    let start = before.rfind(number).map_or(0, |at| at + 1);
    Some(format!("{}{expected} is expected{rest}", &before[..start]))
}

#[cfg(test)]
mod tests {
    use super::in_words;

    #[test]
    fn wrong_numbers_are_explained() {
        let of = |problem: &str| in_words(&format!("invalid value 'x' for '--spp <N>': {problem}\n\nFor more"));
        let expected = |text: &str| format!("invalid value 'x' for '--spp <N>': {text}\n\nFor more");
        assert_eq!(of("invalid digit found in string"), expected("a whole number is expected"));
        assert_eq!(of("-4 is not in 0..=4294967295"), expected("at least 0 is expected"));
        assert_eq!(of("5000 is not in 8..=4096"), expected("8 to 4096 is expected"));
    }
}
