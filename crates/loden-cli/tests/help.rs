//! Help pages, completion scripts and manual pages are complete, and say what the parameter tables say.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::{json, loden, text};
use loden::params::{Kind, Param};

/// The names of all commands as a user types them, subcommands of subcommands included, from the help pages themselves.
fn commands(dir: &Path, parent: &str) -> Vec<String> {
    let help = text(&loden(dir, &format!("{parent} -h")).stdout);
    let listed = help.split("Commands:\n").nth(1).and_then(|list| list.split("\n\n").next()).unwrap_or_default();
    // lines that go on with the description of a command are indented further
    let names = listed.lines().filter_map(|line| line.strip_prefix("  ")).filter(|line| !line.starts_with(' '));
    let names = names.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help");
    let below = |name: &str| {
        let name = format!("{parent} {name}").trim().to_owned();
        let inner = commands(dir, &name);
        [vec![name], inner].concat()
    };
    names.flat_map(below).collect()
}

#[test]
fn every_help_page_is_complete_and_fits_a_terminal() {
    let dir = tempfile::tempdir().unwrap();
    let commands = commands(dir.path(), "");
    assert!(commands.len() > 20 && commands.contains(&"library add".to_owned()), "{commands:?}");
    for command in commands {
        let [short, long] = ["-h", "--help"].map(|flag| loden(dir.path(), &format!("{command} {flag}")));
        assert!(short.status.success() && long.status.success(), "{command}");
        let [short, long] = [text(&short.stdout), text(&long.stdout)];
        let first = short.lines().next().unwrap();
        assert!((10..=100).contains(&first.len()) && !first.ends_with('.'), "{command}: {first}");
        assert!(long.starts_with(first), "{command}: {long}");
        for line in short.lines().chain(long.lines()) {
            assert!(line.chars().count() <= 100 || line.starts_with("Usage") || line.starts_with("  loden"), "{line}");
        }
        let lines: Vec<&str> = short.lines().chain([""]).collect();
        for pair in lines.windows(2).filter(|pair| pair[0].trim_start().starts_with('-')) {
            let beside = pair[0].trim().split("  ").count() > 1;
            assert!(beside || pair[1].starts_with("          "), "{command}: {} has no help", pair[0]);
        }
    }
    let main = text(&loden(dir.path(), "--help").stdout);
    assert!(main.contains("Exit status: 0 success, 1 error, 2 usage error"), "{main}");
}

#[test]
fn every_shell_completes_every_command() {
    let dir = tempfile::tempdir().unwrap();
    let commands = commands(dir.path(), "");
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = text(&loden(dir.path(), &format!("completions {shell}")).stdout);
        // scripts for PowerShell and elvish have no values of flags
        let values =
            ["median-cut", "teapot", "lafortune"].into_iter().filter(|_| ["bash", "zsh", "fish"].contains(&shell));
        for name in commands.iter().flat_map(|command| command.split(' ')).chain(values) {
            assert!(script.contains(name), "{shell} does not complete {name}");
        }
        if shell == "bash" {
            fs::write(dir.path().join("loden.bash"), script).unwrap();
            let check = Command::new("bash").args(["-n", "loden.bash"]).current_dir(dir.path()).output().unwrap();
            assert!(check.status.success(), "{}", text(&check.stderr));
        }
    }
}

#[test]
fn every_command_has_a_manual_page() {
    let dir = tempfile::tempdir().unwrap();
    let files = json(dir.path(), "man --dir pages");
    assert_eq!(files.as_array().unwrap().len(), 1 + commands(dir.path(), "").len());
    let page = fs::read_to_string(dir.path().join("pages/loden-compress.1")).unwrap();
    assert!(
        page.contains(".SH SYNOPSIS")
            && page.contains("max\\-error")
            && page.contains("Parameters of \\-\\-method klt"),
        "{page}"
    );
    assert!(text(&loden(dir.path(), "man").stdout).contains("loden"));
}

/// What the sections of a help page say of parameters: every line `--name <range>`.
fn stated(help: &str) -> Vec<String> {
    let sections = help.split_once("Parameters of").map_or("", |(_, sections)| sections);
    let lines = sections.lines().map(str::trim).filter(|line| line.starts_with("--"));
    let ranges = lines.filter_map(|line| Some(line.split_once('>')?.0.to_owned() + ">"));
    ranges.filter(|line| line.contains("..")).collect()
}

/// What a table says.
fn of_table(params: &[Param]) -> Vec<String> {
    let range = |param: &Param| match param.kind {
        Kind::Integer { min, max } => Some(format!("--{} <{min}..{max}>", param.name)),
        Kind::Real { min, max } => Some(format!("--{} <{min}..{max}>", param.name)),
        _ => None,
    };
    params.iter().filter_map(range).collect()
}

#[test]
fn the_ranges_of_help_pages_are_those_of_the_tables() {
    let dir = tempfile::tempdir().unwrap();
    let help = |line: String| text(&loden(dir.path(), &line).stdout);
    let codecs = loden::codec::CODECS.iter().map(|codec| ("compress --method", codec.name(), codec.params()));
    let factorisations = loden::separable::FACTORISATIONS.iter().map(|f| ("factor --method", f.name(), f.params()));
    let mut all = 0;
    let syntheses = loden::synth::SYNTHESES.iter().map(|s| ("synthesize --method", s.name(), s.params()));
    for (line, name, params) in codecs.chain(factorisations).chain(syntheses) {
        let found = help(format!("{line} {name} --help"));
        assert_eq!(stated(&found), of_table(params), "{line} {name}");
        assert!(params.iter().all(|param| found.contains(&format!("--{}", param.name))), "{line} {name}");
        all += params.len();
    }
    assert!(all > 40, "{all}");
    // without a method all of them are listed
    let whole = stated(&help("compress --help".into()));
    assert_eq!(whole, loden::codec::CODECS.iter().flat_map(|codec| of_table(codec.params())).collect::<Vec<_>>());
    assert!(stated(&help("compress -h".into())).is_empty());
}
