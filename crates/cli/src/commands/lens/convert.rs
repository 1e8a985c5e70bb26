//! `lens convert`.

use super::{GlobalFlags, print_json};
use crate::UsageError;
use crate::output::{Output, distinct};
use crate::watch::say;
use anyhow::anyhow;
use diopter::lens::export::ExportFormat;
use diopter::lens::{State, export};
use diopter::shot::read_lens;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Any lens file as TOML, Zemax or CODE V file.
#[derive(clap::Args, Debug)]
pub struct Convert {
    /// Lens file (.dat, .zmx, .seq, .len, .json, .toml) or the name of an embedded lens.
    lens: String,
    /// File to write: .toml, .zmx (Zemax) or .seq (CODE V), at infinity and the first zoom position; TOML on standard output without.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Convert {
    /// Writes a lens in another format, or as our own sheet.
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let (lens, output) = (&self.lens, self.output.as_deref());
        // A name of an embedded lens is no file here.
        distinct([Path::new(lens)], output)?;
        let prescription = read_lens(lens)?;
        for note in &prescription.notes {
            say(&format!("note: {note}"));
        }
        let mut notes = prescription.notes.clone();
        let format = output.and_then(|path| ExportFormat::of(&path.to_string_lossy()));
        let text = match format {
            None => prescription.to_toml(),
            Some(format) => {
                let exported = export::write(&prescription, State::default(), format)?;
                exported.notes.iter().for_each(|note| say(&format!("note: {note}")));
                notes.extend(exported.notes);
                exported.text
            }
        };
        if global.json && output.is_none() {
            return print_json(&json!({ "name": prescription.name, "notes": notes, "toml": text }));
        }
        match output {
            None => write!(std::io::stdout(), "{text}")?,
            Some(path) => {
                if format.is_none() && path.extension().is_none_or(|e| e != "toml") {
                    let what = anyhow!("{}: expected a name that ends in .toml, .zmx or .seq", path.display());
                    return Err(UsageError(what).into());
                }
                Output::prepare(path)?.commit(|w| Ok(w.write_all(text.as_bytes())?))?;
                say(&format!("wrote {}", path.display()));
                if global.json {
                    return print_json(&json!({ "name": prescription.name, "notes": notes, "files": [path] }));
                }
            }
        }
        Ok(())
    }
}
