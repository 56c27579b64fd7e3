//! `loden brdf models`: the analytic models, as `loden list models` prints them.

use clap::Args;

use super::super::list::{self, What};
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Models {}

impl Models {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        list::print(What::Models, terminal)
    }
}
