//! `loden studio`: materials in a browser.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use clap::Args;
use loden_studio::Config;
use serde_json::json;

use crate::terminal::Terminal;

#[derive(Args)]
#[command(after_long_help = "\
Examples:
  loden studio
  loden studio wool.zip
  loden studio measurements library --output made --port 8080")]
pub struct Studio {
    /// Files and folders of materials; the page sees nothing else [default: the current folder].
    materials: Vec<PathBuf>,
    /// Folder for what is made [default: the first folder of materials, else the current one].
    #[arg(long, short, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Port of the page; 0 is any that is free.
    #[arg(long, default_value_t = 0, value_name = "N")]
    port: u16,
    /// Print the address, but open no browser.
    #[arg(long)]
    no_open: bool,
    /// Largest file that may be dropped on the page, in gigabytes.
    #[arg(long, default_value_t = 4.0, value_name = "GB")]
    upload_limit: f64,
}

impl Studio {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let here = if self.materials.is_empty() { vec![PathBuf::from(".")] } else { self.materials };
        let upload_limit = (self.upload_limit.max(0.0) * 1e9) as u64;
        let config = Config { materials: here, output: self.output, port: self.port, upload_limit };
        let mut printed = Ok(());
        loden_studio::serve(&config, terminal, &mut |address| {
            printed = terminal.result(&json!({ "address": address }), || {
                format!("The studio is at {address} for this machine alone; Ctrl+C ends it")
            });
            if !self.no_open {
                open(address);
            }
        })?;
        printed
    }
}

/// Asks the desktop to open the address. The address has been printed, so nothing is lost if there is no desktop.
fn open(address: &str) {
    let program = if cfg!(target_os = "macos") { "open" } else { "xdg-open" };
    let mut command = match cfg!(windows) {
        true => Command::new("explorer"),
        false => Command::new(program),
    };
    let silent = command.arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let _ = silent.spawn();
}
