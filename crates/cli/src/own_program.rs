//! This program, run by itself: lessons and sheets show what its commands print.

use anyhow::{Context, anyhow};
use diopter::lesson::words;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The program that runs.
pub struct OwnProgram {
    program: PathBuf,
    /// What comes before its arguments: from the Python package it is a module of the interpreter.
    first: &'static [&'static str],
    threads: Option<NonZeroUsize>,
}

impl OwnProgram {
    /// Its commands use as many threads.
    pub fn new(threads: Option<NonZeroUsize>) -> anyhow::Result<OwnProgram> {
        // Of a virtual environment, whose interpreter is a link: the process itself is the one it leads to.
        if let Some(interpreter) = std::env::var_os("DIOPTER_PYTHON") {
            return Ok(OwnProgram { program: interpreter.into(), first: &["-m", "diopter"], threads });
        }
        let program = std::env::current_exe().context("the program itself, which runs the commands")?;
        let name = program.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
        let interpreter = name.starts_with("python") || name.starts_with("pypy");
        Ok(OwnProgram { program, first: if interpreter { &["-m", "diopter"] } else { &[] }, threads })
    }

    /// Runs a command, as it is typed after `diopter`, in a folder (`None`: where this one runs); what it prints. Fails with what it says.
    pub fn run(&self, typed: &str, folder: Option<&Path>) -> anyhow::Result<String> {
        let mut command = Command::new(&self.program);
        command.args(self.first).args(words(typed)).stdin(Stdio::null());
        if let Some(folder) = folder {
            command.current_dir(folder);
        }
        if let Some(threads) = self.threads {
            command.arg("--threads").arg(threads.to_string());
        }
        let done = command.output().with_context(|| self.program.display().to_string())?;
        if !done.status.success() {
            let said = String::from_utf8_lossy(&done.stderr);
            return Err(anyhow!("\"diopter {typed}\" failed: {}", reason(&said)));
        }
        Ok(String::from_utf8_lossy(&done.stdout).into_owned())
    }
}

/// Why a command failed, of all that it said: its errors are a line that begins with its name, those of arguments one that begins with "error: " before hints and usage.
fn reason(said: &str) -> &str {
    let error = said.lines().find_map(|line| line.strip_prefix("error: ").or_else(|| line.strip_prefix("diopter: ")));
    error.unwrap_or_else(|| said.trim().lines().last().unwrap_or(""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_is_found_among_warnings_hints_and_usage() {
        let of_arguments = "error: unexpected argument '--aperture' found\n\n  tip: ...\n\nUsage: diopter calc\n\nFor more information, try '--help'.\n";
        assert_eq!(reason(of_arguments), "unexpected argument '--aperture' found");
        assert_eq!(reason("warning: dark\ndiopter: a.toml: no lens\n"), "a.toml: no lens");
        assert_eq!((reason("killed\n"), reason("")), ("killed", ""));
    }
}
