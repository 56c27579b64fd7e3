//! `loden`: read, compress, compare, evaluate and render measured materials.

mod cmd;
mod flags;
mod report;
mod terminal;

use std::process::ExitCode;

use clap::Parser;

use terminal::Terminal;

/// Measured materials (BTFs): read, compress, compare, evaluate and render them.
///
/// Exit codes: 0 done, 1 failed, 2 used wrongly.
#[derive(Parser)]
#[command(name = "loden", version, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: cmd::Command,

    /// Print the result as JSON on standard output.
    #[arg(long, global = true)]
    json: bool,

    /// Show neither progress nor warnings.
    #[arg(long, short, global = true)]
    quiet: bool,

    /// How many threads to use; the results do not depend on it [default: all processors].
    #[arg(long, global = true, value_name = "N")]
    threads: Option<std::num::NonZeroUsize>,
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let terminal = Terminal::new(cli.json, cli.quiet);
    if let Some(threads) = cli.threads {
        // fails only if a pool exists already, which it does not
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads.get()).build_global();
    }
    match cli.command.run(&terminal) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // the library's errors are whole sentences; others are told with their causes
            match error.downcast_ref::<loden::Error>() {
                Some(error) => eprintln!("error: {error}"),
                None => eprintln!("error: {error:#}"),
            }
            ExitCode::from(exit_code(&error))
        }
    }
}

/// 2 for what the caller can mend by typing something else, 1 for the rest.
fn exit_code(error: &anyhow::Error) -> u8 {
    match error.downcast_ref::<loden::Error>() {
        Some(loden::Error::Parameter { .. }) => 2,
        _ => 1,
    }
}
