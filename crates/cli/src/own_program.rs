//! This program, run by itself: lessons and sheets show what its commands print.

use crate::{Stopped, watch};
use anyhow::{Context, anyhow};
use diopter::lesson::words;
use std::io::Read;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::Duration;

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
        let mut child =
            command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().with_context(|| self.program.display().to_string())?;
        let (printed, said) = (read_all(child.stdout.take()), read_all(child.stderr.take()));
        let mut interrupted = false;
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break status;
            }
            // A signal to this process alone does not reach its children.
            if watch::stopping() && !interrupted {
                interrupt(&mut child);
                interrupted = true;
            }
            std::thread::sleep(LOOK);
        };
        let text = |reader: JoinHandle<Vec<u8>>| String::from_utf8_lossy(&reader.join().unwrap_or_default()).into_owned();
        let (printed, said) = (text(printed), text(said));
        if interrupted {
            return Err(Stopped(format!("stopped in \"diopter {typed}\"")).into());
        }
        if !status.success() {
            return Err(anyhow!("\"diopter {typed}\" failed: {}", reason(&said)));
        }
        Ok(printed)
    }
}

/// How often a running command is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// All that a pipe brings, read beside the program.
fn read_all(pipe: Option<impl Read + Send + 'static>) -> JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        // What was read before it broke is what there is.
        let _ = pipe.map(|mut pipe| pipe.read_to_end(&mut bytes));
        bytes
    })
}

/// Asks a child to end as Ctrl-C does, so that it leaves nothing half-written; where there is no such signal it is ended.
fn interrupt(child: &mut Child) {
    let asked = cfg!(unix) && Command::new("kill").arg("-INT").arg(child.id().to_string()).status().is_ok_and(|s| s.success());
    if !asked {
        // It may have ended by itself.
        let _ = child.kill();
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
