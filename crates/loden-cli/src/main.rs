//! `loden`: read, compress, compare, evaluate and render measured materials.

mod choice;
mod cmd;
mod flags;
mod help;
mod outputs;
mod report;
mod terminal;
mod usage;

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};

use terminal::Terminal;

/// Read, compress, compare, evaluate and render measured materials (BTFs and BRDFs)
///
/// Exit status: 0 success, 1 error, 2 usage error; a command that is interrupted ends by its signal.
#[derive(Parser)]
#[command(
    name = "loden",
    version,
    max_term_width = help::WIDTH,
    after_long_help = "\
Examples:
  loden demo                                            simulate a material, compress and render it, write a page
  loden info wool.zip                                   describe a measurement
  loden compress wool.zip -o wool.loden                 compress it
  loden compare wool.zip wool.loden                     measure the error
  loden render --object cloth --material wool.loden -o wool.png

`loden COMMAND --help` describes a command in full, `loden COMMAND -h` in short."
)]
struct Cli {
    #[command(subcommand)]
    command: cmd::Command,

    /// Print the result as JSON on standard output
    #[arg(long, global = true, help_heading = GLOBAL)]
    json: bool,

    /// Print neither progress nor warnings
    #[arg(long, short, global = true, help_heading = GLOBAL)]
    quiet: bool,

    /// Replace existing outputs, which is refused otherwise; never a source
    #[arg(long, global = true, help_heading = GLOBAL)]
    force: bool,

    /// Number of threads; results do not depend on it [default: all processors]
    #[arg(long, global = true, value_name = "N", help_heading = GLOBAL)]
    threads: Option<std::num::NonZeroUsize>,
}

/// The heading of options that every command has.
const GLOBAL: &str = "Global options";

fn main() -> ExitCode {
    let matches = usage::forgiving(Cli::command()).try_get_matches();
    let cli = match matches.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(error) => return usage::report(&error),
    };
    let terminal = Terminal::new(cli.json, cli.quiet, cli.force);
    if let Some(threads) = cli.threads {
        // fails only if a pool exists already, which it does not
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.get()).build_global();
    }
    let Err(error) = cli.command.run(&terminal) else { return ExitCode::SUCCESS };
    terminal.error(&error);
    if matches!(error.downcast_ref(), Some(loden::Error::Cancelled)) {
        terminal.die_of_signal();
    }
    ExitCode::from(exit_code(&error))
}

/// 2 if the user should type something else, 1 for all other errors.
fn exit_code(error: &anyhow::Error) -> u8 {
    match error.downcast_ref::<loden::Error>() {
        Some(loden::Error::Parameter { .. }) => 2,
        _ => 1,
    }
}
