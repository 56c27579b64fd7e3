//! `loden completions`: completion scripts for shells.

use clap::{Args, CommandFactory};
use clap_complete::Shell;

use crate::Cli;
use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden completions bash > ~/.local/share/bash-completion/completions/loden
  loden completions zsh > \"${fpath[1]}/_loden\"
  loden completions fish > ~/.config/fish/completions/loden.fish
  loden completions powershell >> $PROFILE")]
pub struct Completions {
    /// The shell
    shell: Shell,
}

impl Completions {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "loden", &mut script);
        let script = String::from_utf8_lossy(&script);
        terminal.result(&script, || script.clone().into_owned())
    }
}
