//! `rig`: several cameras on one frame, and all that is known of them.

use super::print_json;
use crate::UsageError;
use crate::args::RigArgs;
use crate::output::Output;
use crate::watch::{self, say, warn, watched};
use anyhow::{Context, anyhow};
use diopter::ExposeError;
use diopter::rig::Rig;
use diopter::shot::ShotError;
use std::cell::Cell;
use std::collections::HashSet;
use std::io::Write;
use std::path::Path;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &RigArgs, json: bool) -> anyhow::Result<()> {
    let _held = watch::hold();
    let rig = Rig::read(&args.rig)?;
    let folder = &args.output;
    let is_new = claim(folder)?;
    let mut told = HashSet::new();
    let mut warn = |text: &str| {
        if told.insert(text.to_owned()) {
            warn(text);
        }
    };
    let saved = Cell::new(0);
    let mut save = |name: &Path, bytes: &[u8]| -> Result<(), ShotError> {
        let path = folder.join(name);
        let failed = |e: anyhow::Error| ShotError::Read { path: path.display().to_string(), reason: format!("{e:#}") };
        if let Some(parent) = path.parent() {
            std::fs::create_dir_all(parent).map_err(|e| failed(e.into()))?;
        }
        let output = Output::prepare(&path).map_err(failed)?;
        output.commit(|to| Ok(to.write_all(bytes)?)).map_err(failed).map(drop)?;
        saved.set(saved.get() + 1);
        Ok(())
    };
    let made = watched("cameras", |w| rig.take(w, &mut warn, &mut save));
    if made.is_err() && is_new {
        // Only if nothing is in it.
        let _ = std::fs::remove_dir(folder);
    }
    let made = made.map_err(|e| match e {
        ShotError::Expose(ExposeError::Cancelled) => {
            let done = match saved.get() {
                0 => String::new(),
                files => format!(", {files} files lie in {}", folder.display()),
            };
            anyhow!(
                "stopped{done}; what lists the pictures is written when all of them are there, and a rig does not go on: expected a new folder for it"
            )
        }
        other => other.into(),
    })?;
    for (camera, rms) in rig.cameras.iter().zip(&made.fit_rms_px) {
        let fit = rms.map_or(String::new(), |rms| format!("   model within {rms:.4} px rms"));
        say(&format!("{}   {} frames{fit}", camera.name, rig.times_s.len()));
    }
    say(&format!("wrote {} files into {}", made.files.len(), folder.display()));
    if json {
        let cameras: Vec<_> = rig
            .cameras
            .iter()
            .zip(&made.fit_rms_px)
            .map(|(c, rms)| serde_json::json!({ "name": c.name, "trigger_offset_s": c.trigger_s, "fit_rms_px": rms }))
            .collect();
        let files: Vec<_> = made.files.iter().map(|f| folder.join(f)).collect();
        print_json(&serde_json::json!({ "files": files, "cameras": cameras, "frames": rig.times_s }))?;
    }
    Ok(())
}

/// The folder is a new one (made here) or empty: nothing of another rig is mixed in. Whether it was made.
fn claim(folder: &Path) -> anyhow::Result<bool> {
    match std::fs::read_dir(folder) {
        Ok(mut entries) => match entries.next() {
            None => Ok(false),
            Some(_) => Err(UsageError(anyhow!("{}: it is not empty; expected a new or empty folder", folder.display())).into()),
        },
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
            std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
            Ok(true)
        }
        Err(e) => Err(e).with_context(|| format!("{}: cannot be written", folder.display())),
    }
}
