//! Man page and completions, from the same source as the help.

use crate::args::Args;
use clap::CommandFactory;

pub fn completions(shell: clap_complete::Shell) -> anyhow::Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Args::command(), "diopter", &mut text);
    write_all(&text)
}

pub fn man() -> anyhow::Result<()> {
    let mut text = Vec::new();
    clap_mangen::Man::new(Args::command()).render(&mut text)?;
    write_all(&text)
}

fn write_all(text: &[u8]) -> anyhow::Result<()> {
    use std::io::Write;
    Ok(std::io::stdout().write_all(text)?)
}
