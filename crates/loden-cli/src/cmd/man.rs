//! `loden man`: manual pages.

use std::io::Write;
use std::path::PathBuf;

use clap::builder::Resettable;
use clap::{Args, Command, CommandFactory};
use clap_mangen::Man as Page;

use crate::Cli;
use crate::outputs::Outputs;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden man | man -l -
  loden man -o ~/.local/share/man/man1")]
pub struct Man {
    /// Write the pages of all commands into this folder, instead of printing the first one
    #[arg(long, short, alias = "dir", value_name = "DIR")]
    output: Option<PathBuf>,
}

impl Man {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let mut command = Cli::command();
        command.build();
        let Some(folder) = self.output else {
            let mut page = Vec::new();
            write(command, &mut page)?;
            let page = String::from_utf8_lossy(&page);
            return terminal.result(&page, || page.clone().into_owned());
        };
        loden::output::create_folder(&folder)?;
        let outputs = Outputs::new(terminal, None::<PathBuf>);
        let mut files = Vec::new();
        let mut left = vec![command];
        while let Some(command) = left.pop() {
            left.extend(command.get_subcommands().filter(|command| command.get_name() != "help").cloned());
            let path = folder.join(Page::new(command.clone()).get_filename());
            let target = outputs.file(&path, &[])?;
            loden::output::write_file(target.path(), |out| write(command, out))?;
            files.push(path);
        }
        files.sort();
        let list = files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join("\n");
        terminal.result(&files, || list)
    }
}

/// A page whose end, sections and examples, keeps its lines.
fn write(command: Command, out: &mut dyn Write) -> std::io::Result<()> {
    let end = command.get_after_long_help().map(ToString::to_string).unwrap_or_default();
    // the sections explain what is left out of the long help
    let command = command.mut_args(|arg| if arg.is_hide_long_help_set() { arg.hide(true) } else { arg });
    Page::new(command.after_long_help(Resettable::Reset)).render(out)?;
    let escape = |line: &str| format!("\\&{}\n", line.replace('\\', "\\e").replace('-', "\\-"));
    let lines: String = end.lines().map(escape).collect();
    write!(out, ".SH NOTES\n.nf\n{lines}.fi\n")
}
