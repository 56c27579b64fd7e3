//! `loden shard`: a compression by many processes that share a folder.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use loden::codec::{self, Finish, lossless};
use loden::job::{self, ShardNext, ShardPlan};
use loden::memory::Memory;
use serde_json::json;

use super::compress::{self, Codecs, Wanted};
use crate::choice::{self, NONE};
use crate::flags::{Assumptions, Flags};
use crate::outputs::Outputs;
use crate::report;
use crate::terminal::Terminal;

#[derive(Args)]
pub struct Shard {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Begin a job: write its plan and the first stage into a new folder
    Plan(Box<Plan>),
    /// Run one task of a stage
    ///
    /// May run on any machine that sees the folder and the source, and more than once. Tasks beyond those of the stage do
    /// nothing, so that every stage can have an array of the same size.
    Run {
        /// The folder of the job.
        job: PathBuf,
        /// Number of the stage, as printed by `plan` and `next`.
        #[arg(long)]
        stage: usize,
        /// Number of the task, from 0.
        #[arg(long)]
        task: usize,
    },
    /// Combine the results of all tasks: prepare the next stage, or write the file
    ///
    /// Without all results, prints the tasks that lack one. The last stage removes the folder.
    Next {
        /// The folder of the job.
        job: PathBuf,
    },
}

#[derive(Args)]
#[command(after_long_help = compress::epilogue(&EXAMPLES))]
struct Plan {
    /// The BTF: any file or folder that `loden info` recognises, by a name that all machines know.
    source: PathBuf,
    /// Compression method.
    #[arg(long, default_value = codec::DEFAULT, value_parser = choice::method())]
    method: String,
    /// File to write in the end, .loden.
    #[arg(long, short, value_name = "FILE")]
    output: PathBuf,
    /// New folder of the job, on storage that all machines share.
    #[arg(long, value_name = "DIR")]
    job: PathBuf,
    /// Largest number of tasks of a stage.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..))]
    tasks: u32,
    #[command(flatten)]
    wanted: Wanted,
    /// Pack the file by a lossless compressor.
    #[arg(long, value_name = "STAGE", default_value = NONE, value_parser = choice::stage())]
    lossless: String,
    /// Memory limit of each task, such as 2G.
    #[arg(long, value_name = "BYTES")]
    memory: Option<Memory>,
    #[command(flatten)]
    assumptions: Assumptions,
    #[command(flatten)]
    params: Flags<Codecs>,
}

const EXAMPLES: [&str; 3] = [
    "loden shard plan wool.btf --method pvmf -o wool.loden --job wool.job --tasks 64",
    "loden shard run wool.job --stage 0 --task 5",
    "loden shard next wool.job",
];

impl Shard {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        match self.command {
            Command::Plan(plan) => plan.run(terminal),
            Command::Run { job, stage, task } => {
                let plan = ShardPlan::read(&job)?;
                let tasks = job::shard_tasks(&job, stage)?;
                if task < tasks {
                    job::run_shard(&job, &plan, plan.open()?.as_ref(), [stage, task], terminal)?;
                }
                let value = json!({ "job": job, "stage": stage, "task": task, "tasks": tasks });
                terminal.result(&value, || format!("stage {stage}: task {task} of {tasks}"))
            }
            Command::Next { job } => show(&job::next_shards(&job, terminal)?, terminal),
        }
    }
}

impl Plan {
    fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        let outputs = Outputs::new(terminal, [&self.source]);
        let target = outputs.file(&self.output, &["loden"])?;
        outputs.folder(&self.job)?;
        let lossless = (self.lossless != NONE).then(|| lossless::by_name(&self.lossless)).transpose()?;
        let finish = Finish { measure: !self.wanted.no_error, lossless };
        let source = job::open_btf(&self.source, self.assumptions.given(), terminal)?;
        let (params, tasks) = (self.params.given().clone(), self.tasks as usize);
        let plan = ShardPlan::new(
            source.as_ref(),
            target.path(),
            &self.method,
            params,
            self.wanted.goal(),
            finish,
            tasks,
            self.memory,
        )?;
        plan.write(&self.job)?;
        show(&job::next_shards(&self.job, terminal)?, terminal)
    }
}

fn show(next: &ShardNext, terminal: &Terminal) -> anyhow::Result<()> {
    terminal.result(next, || match next {
        ShardNext::Tasks(waiting) => {
            let (stage, tasks, missing) = (waiting.stage, waiting.tasks, waiting.missing.len());
            format!("stage {stage} ({}): {tasks} tasks, {missing} of them without a result", waiting.kernel)
        }
        ShardNext::Done(done) => {
            let (file, size) = (done.output.display(), report::bytes(done.bytes));
            let error = done.error.map_or(String::new(), |e| format!(", mean error {:.4}", e.mean_abs_error));
            format!("{file}: {size}, 1/{:.1} of the raw 8-bit data{error}", done.ratio_raw8)
        }
    })
}
