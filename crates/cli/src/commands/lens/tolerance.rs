//! `lens tolerance` and `lens build`: what a lens will be when it is built.

use super::{GlobalFlags, print_json};
use crate::html::escaped;
use crate::output::{Output, distinct};
use crate::watch::say;
use crate::{UsageError, paint};
use anyhow::{Context, anyhow};
use diopter::files;
use diopter::lens::Prescription;
use diopter::lens::draw::{Distributed, Figure, distribution_plot};
use diopter::lens::tolerance::{FieldWithoutImage, QuantityKind, Sensitivity, Summary, ToleranceSheet, Toleranced, yield_of};
use diopter::shot::{ShotError, lens_beside, read_lens};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Most builds of a run, and most numbers of all of them: they are in memory until they are written.
const MOST_BUILDS: usize = 1_000_000;
const MOST_NUMBERS: usize = 50_000_000;
/// Perturbations that the text names; files have all.
const NAMED: usize = 12;

/// Everything that was found out.
struct Report {
    toleranced: Toleranced,
    sensitivities: Vec<Sensitivity>,
    rss: Vec<f64>,
    builds: Vec<Vec<f64>>,
    summaries: Vec<Summary>,
    good: Vec<bool>,
    seed: u64,
}

/// Text of a sheet file.
pub(super) fn read_sheet(path: &Path) -> anyhow::Result<String> {
    files::read_text(path).with_context(|| path.display().to_string())
}

/// The lens that is asked for, else the one a sheet names; a file stands beside the sheet.
pub(super) fn lens_of(asked: Option<&str>, named: Option<&str>, sheet: &Path) -> anyhow::Result<Prescription> {
    let name = match (asked, named) {
        (Some(asked), _) => asked.to_owned(),
        (None, Some(named)) => lens_beside(named, sheet),
        (None, None) => {
            let what = "no lens: expected lens = \"...\" in the file, or --lens NAME";
            return Err(UsageError(anyhow!("{}: {what}", sheet.display())).into());
        }
    };
    let prescription = read_lens(&name)?;
    prescription.notes.iter().for_each(|note| say(&format!("note: {note}")));
    Ok(prescription)
}

fn toleranced(sheet: &Path, lens: Option<&str>, seed: Option<u64>) -> anyhow::Result<(Toleranced, u64)> {
    let text = read_sheet(sheet)?;
    let wrong = |e: diopter::lens::LensError| anyhow::Error::from(ShotError::from(e));
    let mut parsed = ToleranceSheet::parse(&text, &sheet.display().to_string()).map_err(|e| wrong(e.into()))?;
    parsed.seed = seed.unwrap_or(parsed.seed);
    let prescription = lens_of(lens, parsed.lens.as_deref(), sheet)?;
    Ok((Toleranced::new(&prescription, &parsed).map_err(wrong)?, parsed.seed))
}

/// Files that a report is written to.
enum Target {
    Text(Output, fn(&Report) -> anyhow::Result<String>),
    Plot(PathBuf),
}

/// What the lens will be when it is built: sensitivities, Monte Carlo, yield against limits.
#[derive(clap::Args, Debug)]
pub struct Tolerance {
    /// Tolerance sheet (.toml).
    sheet: PathBuf,
    /// The lens, instead of the one the sheet names: a name from `lens list`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    lens: Option<String>,
    /// Builds that are drawn and measured.
    #[arg(short = 'n', long, value_name = "N", default_value_t = 1000)]
    builds: usize,
    /// Seed of the builds, instead of the sheet's.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Report (.html), all builds (.csv), everything (.json) or histograms (.svg, .png); may be given several times.
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
}

impl Tolerance {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        if !(1..=MOST_BUILDS).contains(&self.builds) {
            return Err(UsageError(anyhow!("builds {}: expected 1 to {MOST_BUILDS}", self.builds)).into());
        }
        distinct([self.sheet.as_path()], self.output.iter().map(PathBuf::as_path))?;
        // Whether files can be written is known before the work.
        let target = |path: &PathBuf| {
            let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
            let text: fn(&Report) -> anyhow::Result<String> = match ending.as_deref() {
                Some("html") => |r| Ok(html(r)),
                Some("csv") => |r| Ok(csv(r)),
                Some("json") => |r| Ok(format!("{:#}\n", as_json(r))),
                Some("svg" | "png") => return Ok(Target::Plot(path.clone())),
                _ => {
                    let what = anyhow!("{}: expected a name that ends in .html, .csv, .json, .svg or .png", path.display());
                    return Err(UsageError(what).into());
                }
            };
            Ok(Target::Text(Output::prepare(path)?, text))
        };
        let targets: Vec<Target> = self.output.iter().map(target).collect::<anyhow::Result<_>>()?;
        let plots: Vec<PathBuf> =
            targets.iter().filter_map(|t| if let Target::Plot(p) = t { Some(p.clone()) } else { None }).collect();
        let plots = paint::prepare(&plots)?;
        let (toleranced, seed) = toleranced(&self.sheet, self.lens.as_deref(), self.seed)?;
        let numbers = self.builds.saturating_mul(toleranced.quantities().len());
        if numbers > MOST_NUMBERS {
            let most = MOST_NUMBERS / toleranced.quantities().len();
            let found = format!("{} builds of {} quantities", self.builds, toleranced.quantities().len());
            return Err(
                UsageError(anyhow!("-n: {found}; expected at most {most} builds, or fewer fields and frequencies")).into()
            );
        }
        let report = Report::new(toleranced, self.builds, seed);
        report.warnings().iter().for_each(|warning| say(&format!("warning: {warning}")));
        for target in targets {
            if let Target::Text(output, text) = target {
                let text = text(&report)?;
                let path = output.commit(|w| Ok(w.write_all(text.as_bytes())?))?;
                say(&format!("wrote {}", path.display()));
            }
        }
        for path in paint::write(plots, &histograms(&report))? {
            say(&format!("wrote {}", path.display()));
        }
        if global.json {
            return print_json(&as_json(&report));
        }
        write!(std::io::stdout(), "{}", text(&report)?)?;
        Ok(())
    }
}

/// One build of a tolerance sheet as a lens file, for `shoot --lens` and all other verbs.
#[derive(clap::Args, Debug)]
pub struct Build {
    /// Tolerance sheet (.toml).
    sheet: PathBuf,
    /// The lens, instead of the one the sheet names: a name from `lens list`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    lens: Option<String>,
    /// Which build: the same number is the same lens.
    #[arg(long, value_name = "N")]
    number: u64,
    /// Seed of the builds, instead of the sheet's.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Lens file to write (.toml); standard output without.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Build {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        distinct([self.sheet.as_path()], self.output.as_deref())?;
        let output = match &self.output {
            Some(path) if path.extension().is_none_or(|e| e != "toml") => {
                return Err(UsageError(anyhow!("{}: expected a name that ends in .toml", path.display())).into());
            }
            Some(path) => Some(Output::prepare(path)?),
            None => None,
        };
        let (toleranced, seed) = toleranced(&self.sheet, self.lens.as_deref(), self.seed)?;
        let lens = toleranced.build(self.number).map_err(ShotError::from)?;
        let text = lens.to_toml();
        if let Some(output) = output {
            let path = output.commit(|w| Ok(w.write_all(text.as_bytes())?))?;
            say(&format!("wrote {}", path.display()));
        }
        if global.json {
            let amounts = toleranced.amounts(self.number);
            let amounts: Vec<Value> = toleranced
                .parameters()
                .iter()
                .zip(amounts)
                .map(|(p, a)| json!({ "name": p.name(), "unit": p.unit(), "amount": a }))
                .collect();
            // Of the build before its film was moved: that is one of the quantities.
            let values = toleranced.measure_build(self.number);
            return print_json(&json!({ "number": self.number, "seed": seed, "amounts": amounts,
            "quantities": named(&toleranced, &values), "toml": text }));
        }
        if self.output.is_none() {
            write!(std::io::stdout(), "{text}")?;
        }
        Ok(())
    }
}

/// Quantities by their names.
fn named(toleranced: &Toleranced, values: &[f64]) -> Value {
    toleranced.quantities().iter().zip(values).map(|(q, v)| (q.name(), json!(v))).collect::<serde_json::Map<_, _>>().into()
}

/// What a page about the lens says of its builds: a line, rows of the quantities (the first is the head), and lines of the limits and of the
/// perturbations that cost most.
pub(super) fn summary(sheet: &Path, lens: &str, builds: usize) -> anyhow::Result<(String, Vec<Vec<String>>, Vec<String>)> {
    if !(1..=MOST_BUILDS).contains(&builds) {
        return Err(UsageError(anyhow!("builds {builds}: expected 1 to {MOST_BUILDS}")).into());
    }
    let (toleranced, seed) = toleranced(sheet, Some(lens), None)?;
    let r = Report::new(toleranced, builds, seed);
    let t = &r.toleranced;
    let mut rows = vec![["", "design", "mean", "deviation", "2 %", "98 %"].map(str::to_owned).to_vec()];
    for (i, (q, s)) in t.quantities().iter().zip(&r.summaries).enumerate() {
        let values = [t.nominal()[i], s.mean, s.deviation, s.percentiles[0], s.percentiles[4]];
        let name = format!("{} {}", q.name(), q.unit()).trim_end().to_owned();
        rows.push([name].into_iter().chain(values.map(|v| format!("{v:.4}"))).collect());
    }
    let mut lines: Vec<String> =
        r.yields().into_iter().map(|(name, f, interval)| format!("limit {name}: {}", percent((f, interval)))).collect();
    if !t.limits().is_empty() {
        lines.push(format!("yield: {}", percent(r.total_yield())));
    }
    let named =
        |i: usize| format!("{} ({:.3e} {})", t.parameters()[i].name(), t.parameters()[i].half_range, t.parameters()[i].unit());
    lines.extend(r.warnings());
    let worst: Vec<String> = r.worst_first().into_iter().take(NAMED / 2).map(named).collect();
    lines.push(format!("What costs most contrast: {}", worst.join("; ")));
    Ok((r.title(), rows, lines))
}

impl Report {
    /// In the order of their numbers, however many threads there are.
    fn new(toleranced: Toleranced, builds: usize, seed: u64) -> Report {
        let sensitivities: Vec<Sensitivity> =
            (0..toleranced.parameters().len()).into_par_iter().map(|i| toleranced.sensitivity(i)).collect();
        let builds: Vec<Vec<f64>> = (0..builds as u64).into_par_iter().map(|number| toleranced.measure_build(number)).collect();
        let summaries = (0..toleranced.quantities().len()).map(|q| Summary::of(builds.iter().map(|b| b[q]))).collect();
        let good = builds.iter().map(|b| toleranced.is_good(b)).collect();
        let rss = toleranced.root_sum_square(&sensitivities);
        Report { toleranced, sensitivities, rss, builds, summaries, good, seed }
    }

    fn title(&self) -> String {
        let t = &self.toleranced;
        let builds = self.builds.len();
        format!("{}: {builds} builds of seed {}, {} perturbations", t.design().name, self.seed, t.parameters().len())
    }

    /// What is said of fields whose numbers mean nothing.
    fn warnings(&self) -> Vec<String> {
        let of = |f: FieldWithoutImage| {
            let (field, spot) = (f.field_deg, f.spot_um);
            let contrast = f
                .frequency
                .map_or("".into(), |v| format!(", contrast at {v} cycles/mm is numerical noise, and its yield with it"));
            format!(
                "field {field}°: spots of {spot:.0} µm (root mean square) are no image{contrast}; expected fields within the picture"
            )
        };
        self.toleranced.fields_without_image().into_iter().map(of).collect()
    }

    /// Builds that keep all limits: fraction, and 95 % interval.
    fn total_yield(&self) -> (f64, [f64; 2]) {
        yield_of(self.good.iter().filter(|g| **g).count(), self.good.len())
    }

    /// Yield of each limit by itself.
    fn yields(&self) -> Vec<(String, f64, [f64; 2])> {
        let t = &self.toleranced;
        let of = |(i, limit): (usize, &diopter::lens::tolerance::Limit)| {
            let good = self.builds.iter().filter(|b| t.keeps(i, b)).count();
            let (fraction, interval) = yield_of(good, self.builds.len());
            (limit.name(), fraction, interval)
        };
        t.limits().iter().enumerate().map(of).collect()
    }

    /// Mean change of all quantities of a kind at one end of a perturbation.
    fn change(&self, kind: QuantityKind, values: &[f64]) -> f64 {
        let t = &self.toleranced;
        let of: Vec<f64> =
            (0..values.len()).filter(|q| t.quantities()[*q].kind == kind).map(|q| values[q] - t.nominal()[q]).collect();
        of.iter().sum::<f64>() / of.len().max(1) as f64
    }

    /// Numbers of the perturbations, the one that costs most contrast first.
    fn worst_first(&self) -> Vec<usize> {
        let loss = |i: &usize| {
            let s = &self.sensitivities[*i];
            let worst = |v: &[f64]| self.change(QuantityKind::Mtf, v);
            // A perturbation that lets no light through is the worst.
            match worst(&s.plus).min(worst(&s.minus)) {
                v if v.is_finite() => v,
                _ => f64::NEG_INFINITY,
            }
        };
        let mut order: Vec<usize> = (0..self.sensitivities.len()).collect();
        order.sort_by(|a, b| loss(a).total_cmp(&loss(b)));
        order
    }
}

fn percent((fraction, [low, high]): (f64, [f64; 2])) -> String {
    format!("{:.1} % (95 %: {:.1} to {:.1})", 100.0 * fraction, 100.0 * low, 100.0 * high)
}

fn text(r: &Report) -> anyhow::Result<String> {
    let t = &r.toleranced;
    let mut out = format!("{}\n", r.title());
    writeln!(
        out,
        "  {:<40} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}",
        "", "design", "mean", "deviation", "RSS", "2 %", "50 %", "98 %"
    )?;
    for (q, s) in t.quantities().iter().zip(&r.summaries).enumerate().map(|(i, (q, s))| ((i, q), s)) {
        let (i, q) = q;
        let label = format!("{} {}", q.name(), q.unit());
        let [p2, _, p50, _, p98] = s.percentiles;
        writeln!(
            out,
            "  {label:<40} {:>10.4} {:>10.4} {:>10.4} {:>10.4} {p2:>10.4} {p50:>10.4} {p98:>10.4}{}",
            t.nominal()[i],
            s.mean,
            s.deviation,
            r.rss[i],
            if s.missing > 0 { format!("  ({} without light)", s.missing) } else { String::new() }
        )?;
    }
    writeln!(
        out,
        "  {:<40} {:>12} {:>10} {:>10} {:>10} {:>10}",
        "perturbations, mean change over fields", "amount", "mtf +", "mtf -", "spot µm +", "spot µm -"
    )?;
    for i in r.worst_first().into_iter().take(NAMED) {
        let (p, s) = (&t.parameters()[i], &r.sensitivities[i]);
        writeln!(
            out,
            "  {:<40} {:>12} {:>10.4} {:>10.4} {:>10.3} {:>10.3}",
            p.name(),
            format!("{:.4e} {}", p.half_range, p.unit()),
            r.change(QuantityKind::Mtf, &s.plus),
            r.change(QuantityKind::Mtf, &s.minus),
            r.change(QuantityKind::Spot, &s.plus),
            r.change(QuantityKind::Spot, &s.minus)
        )?;
    }
    if r.sensitivities.len() > NAMED {
        writeln!(out, "  ... and {} that cost less contrast (-o FILE.html or .json has all)", r.sensitivities.len() - NAMED)?;
    }
    for (name, fraction, interval) in r.yields() {
        writeln!(out, "  limit {name}: {}", percent((fraction, interval)))?;
    }
    if !t.limits().is_empty() {
        writeln!(out, "  yield: {}", percent(r.total_yield()))?;
    }
    Ok(out)
}

fn as_json(r: &Report) -> Value {
    let t = &r.toleranced;
    let quantities: Vec<Value> = t
        .quantities()
        .iter()
        .enumerate()
        .map(|(i, q)| {
            let s = &r.summaries[i];
            json!({ "name": q.name(), "quantity": q.kind.name(), "unit": q.unit(), "field_deg": q.field_deg, "frequency_per_mm": q.frequency,
                "design": t.nominal()[i], "mean": s.mean, "deviation": s.deviation, "rss": r.rss[i], "percents": Summary::PERCENTS,
                "percentiles": s.percentiles, "range": s.range, "missing": s.missing })
        })
        .collect();
    let perturbations: Vec<Value> = t
        .parameters()
        .iter()
        .zip(&r.sensitivities)
        .map(|(p, s)| json!({ "name": p.name(), "unit": p.unit(), "half_range": p.half_range, "plus": s.plus, "minus": s.minus }))
        .collect();
    let limits: Vec<Value> = r
        .yields()
        .into_iter()
        .map(|(name, fraction, interval)| json!({ "name": name, "yield": fraction, "interval_95": interval }))
        .collect();
    let (fraction, interval) = r.total_yield();
    json!({ "lens": t.design().name, "seed": r.seed, "quantities": quantities, "perturbations": perturbations, "limits": limits,
        "warnings": r.warnings(), "yield": fraction, "yield_interval_95": interval, "builds": r.builds, "good": r.good })
}

fn csv(r: &Report) -> String {
    // Names have commas: they are quoted.
    let names: Vec<String> = r.toleranced.quantities().iter().map(|q| format!("\"{} {}\"", q.name(), q.unit())).collect();
    let mut out = format!("build,good,{}\n", names.join(","));
    for (number, values) in r.builds.iter().enumerate() {
        let values: Vec<String> = values.iter().map(f64::to_string).collect();
        let _ = writeln!(out, "{number},{},{}", r.good[number], values.join(","));
    }
    out
}

fn histograms(r: &Report) -> Figure {
    let t = &r.toleranced;
    let of = |(i, q): (usize, &diopter::lens::tolerance::Quantity)| {
        let matching = t.limits().iter().filter(|l| l.matches(q));
        let limits = matching.flat_map(|l| [l.at_least, l.at_most]).flatten().collect();
        let unit = q.unit();
        let label = if unit.is_empty() { q.name() } else { format!("{}, {unit}", q.name()) };
        Distributed { label, values: r.builds.iter().map(|b| b[i]).collect(), nominal: t.nominal()[i], limits }
    };
    distribution_plot(&r.title(), &t.quantities().iter().enumerate().map(of).collect::<Vec<_>>())
}

fn html(r: &Report) -> String {
    let t = &r.toleranced;
    let title = escaped(&r.title());
    let mut out = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title><style>\n\
         body {{ font: 14px sans-serif; margin: 2em; }} table {{ border-collapse: collapse; margin: 1em 0; }}\n\
         td, th {{ padding: 2px 10px; text-align: right; border-bottom: 1px solid #ddd; }} td:first-child {{ text-align: left; }}\n\
         </style></head><body>\n<h1>{title}</h1>\n"
    );
    let table = |out: &mut String, head: &[&str], rows: &mut dyn Iterator<Item = Vec<String>>| {
        let cells = |tag: &str, row: &[String]| row.iter().map(|c| format!("<{tag}>{}</{tag}>", escaped(c))).collect::<String>();
        let head: Vec<String> = head.iter().map(|h| (*h).to_owned()).collect();
        let _ = writeln!(out, "<table><tr>{}</tr>", cells("th", &head));
        rows.for_each(|row| {
            let _ = writeln!(out, "<tr>{}</tr>", cells("td", &row));
        });
        out.push_str("</table>\n");
    };
    for warning in r.warnings() {
        let _ = writeln!(out, "<p><b>{}</b></p>", escaped(&warning));
    }
    if !t.limits().is_empty() {
        let _ = writeln!(out, "<h2>Yield: {}</h2>", escaped(&percent(r.total_yield())));
        let mut rows = r.yields().into_iter().map(|(name, fraction, interval)| vec![name, percent((fraction, interval))]);
        table(&mut out, &["limit", "yield"], &mut rows);
    }
    out.push_str("<h2>Quantities</h2>\n");
    let mut rows = t.quantities().iter().enumerate().map(|(i, q)| {
        let s = &r.summaries[i];
        let mut row = vec![format!("{} {}", q.name(), q.unit())];
        row.extend([t.nominal()[i], s.mean, s.deviation, r.rss[i]].map(|v| format!("{v:.4}")));
        row.extend(s.percentiles.map(|v| format!("{v:.4}")));
        row.push(s.missing.to_string());
        row
    });
    let head = ["", "design", "mean", "deviation", "RSS", "2 %", "10 %", "50 %", "90 %", "98 %", "without light"];
    table(&mut out, &head, &mut rows);
    out.push_str(&histograms(r).to_svg());
    out.push_str("<h2>Perturbations, each alone: mean change over the fields</h2>\n");
    let mut rows = r.worst_first().into_iter().map(|i| {
        let (p, s) = (&t.parameters()[i], &r.sensitivities[i]);
        let mut row = vec![p.name(), format!("±{:.4e} {}", p.half_range, p.unit())];
        for kind in [QuantityKind::Mtf, QuantityKind::Spot, QuantityKind::Efl] {
            row.extend([&s.plus, &s.minus].map(|v| format!("{:+.4}", r.change(kind, v))));
        }
        row
    });
    table(&mut out, &["", "amount", "mtf +", "mtf −", "spot µm +", "spot µm −", "efl mm +", "efl mm −"], &mut rows);
    out.push_str("</body></html>\n");
    out
}
