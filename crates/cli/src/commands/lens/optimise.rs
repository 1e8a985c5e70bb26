//! `lens optimise`: a better lens from a given one.

use super::tolerance::{lens_of, read_sheet};
use super::{GlobalFlags, print_json};
use crate::UsageError;
use crate::output::{Output, distinct};
use crate::watch::say;
use anyhow::anyhow;
use diopter::lens::optimise::{MeritSheet, Optimisation, OptimisationReport, Wanted};
use diopter::shot::ShotError;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::PathBuf;

/// Most generations, and most steps.
const MOST: usize = 100_000;

/// A better lens: variables and wishes from a merit file, damped least squares, a global search.
#[derive(clap::Args, Debug)]
pub struct Optimise {
    /// Merit file (.toml): variables, operands, fields.
    merit: PathBuf,
    /// The lens to start from, instead of the one the merit file names: a name from `lens list`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    lens: Option<String>,
    /// Search the whole range of the variables first, by so many generations of differential evolution.
    #[arg(long, value_name = "N", default_value_t = 0)]
    global: usize,
    /// Most steps of the damped least squares.
    #[arg(long, value_name = "N", default_value_t = 500)]
    iterations: usize,
    /// Seed of the global search, instead of the file's.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Lens file to write (.toml).
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Optimise {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        distinct([self.merit.as_path()], self.output.as_deref())?;
        for (what, count) in [("global", self.global), ("iterations", self.iterations)] {
            if count > MOST {
                return Err(UsageError(anyhow!("{what} {count}: expected at most {MOST}")).into());
            }
        }
        let output = match &self.output {
            Some(path) if path.extension().is_none_or(|e| e != "toml") => {
                return Err(UsageError(anyhow!("{}: expected a name that ends in .toml", path.display())).into());
            }
            Some(path) => Some(Output::prepare(path)?),
            None => None,
        };
        let text = read_sheet(&self.merit)?;
        let wrong = |e: diopter::lens::LensError| anyhow::Error::from(ShotError::from(e));
        let mut sheet = MeritSheet::parse(&text, &self.merit.display().to_string()).map_err(|e| wrong(e.into()))?;
        sheet.seed = self.seed.unwrap_or(sheet.seed);
        let lens = lens_of(self.lens.as_deref(), sheet.lens.as_deref(), &self.merit)?;
        let report = Optimisation::new(&lens, &sheet).and_then(|o| o.run(self.global, self.iterations)).map_err(wrong)?;
        let toml = report.lens.to_toml();
        if let Some(output) = output {
            let path = output.commit(|w| Ok(w.write_all(toml.as_bytes())?))?;
            say(&format!("wrote {}", path.display()));
        }
        if global.json {
            return print_json(&as_json(&report, &toml));
        }
        write!(std::io::stdout(), "{}", table(&report)?)?;
        Ok(())
    }
}

fn wanted(w: Wanted) -> String {
    match w {
        Wanted::Target(t) => format!("{t}"),
        Wanted::Within([low, high]) if high == f64::INFINITY => format!("≥ {low}"),
        Wanted::Within([low, high]) if low == f64::NEG_INFINITY => format!("≤ {high}"),
        Wanted::Within([low, high]) => format!("{low} to {high}"),
    }
}

fn table(r: &OptimisationReport) -> anyhow::Result<String> {
    let mut t =
        format!("{}: merit {:.6e} to {:.6e}, {} steps; {}\n", r.lens.name, r.merits[0], r.merits[1], r.iterations, r.stop);
    writeln!(t, "  {:<32} {:>14} {:>14} {:>14} {:>12} {:>12}", "operand", "wanted", "before", "after", "merit before", "after")?;
    for o in &r.operands {
        writeln!(
            t,
            "  {:<32} {:>14} {:>14.6} {:>14.6} {:>12.4e} {:>12.4e}",
            format!("{} {}", o.name, o.unit),
            wanted(o.wanted),
            o.values[0],
            o.values[1],
            o.merits[0],
            o.merits[1]
        )?;
    }
    writeln!(t, "  {:<32} {:>14} {:>14}", "variable", "before", "after")?;
    for (name, before, after, on_bound) in &r.variables {
        writeln!(t, "  {name:<32} {before:>14.8} {after:>14.8}{}", if *on_bound { "  on its bound" } else { "" })?;
    }
    for (surface, before, after) in &r.glasses {
        writeln!(t, "  {:<32} {before:>14} {after:>14}", format!("glass after surface {}", surface + 1))?;
    }
    if !r.glasses.is_empty() {
        writeln!(t, "  {} exchanges of a glass tried", r.exchanges)?;
    }
    Ok(t)
}

fn as_json(r: &OptimisationReport, toml: &str) -> Value {
    let operands: Vec<Value> = r
        .operands
        .iter()
        .map(|o| json!({ "name": o.name, "unit": o.unit, "wanted": wanted(o.wanted), "values": o.values, "merits": o.merits }))
        .collect();
    let variables: Vec<Value> = r
        .variables
        .iter()
        .map(|(name, before, after, on_bound)| json!({ "name": name, "before": before, "after": after, "on_bound": on_bound }))
        .collect();
    let glasses: Vec<Value> = r
        .glasses
        .iter()
        .map(|(surface, before, after)| json!({ "after_surface": surface + 1, "before": before, "after": after }))
        .collect();
    json!({ "merits": r.merits, "iterations": r.iterations, "stop": r.stop.to_string(), "operands": operands, "variables": variables,
        "glasses": glasses, "exchanges": r.exchanges, "toml": toml })
}
