//! `lens report`: one page about a lens, for paper.

use super::bench::{Bench, Table, fields_to};
use super::draw::layout;
use super::{GlobalFlags, print_json, tolerance};
use crate::UsageError;
use crate::document::{self, Block, Document};
use crate::output::distinct;
use crate::own_program::OwnProgram;
use crate::paint;
use crate::watch::say;
use anyhow::{Context, anyhow};
use diopter::lens::analysis::{Fan, FieldPoint, Illumination, Mtf, Spot, ThirdOrder, airy_mtf};
use diopter::lens::draw::{self, Figure};
use diopter::lens::glass::{Glass, GlassKind};
use diopter::lens::paraxial::FirstOrder;
use diopter::lens::surface::Profile;
use serde_json::json;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Spatial frequencies of the contrast over field and focus, 1/mm.
const FREQUENCIES: [f64; 3] = [10.0, 20.0, 40.0];
/// Highest frequency of the contrast curves, 1/mm.
const HIGHEST: f64 = 100.0;
/// Rays across the pupil of a spot diagram.
const SPOT_RAYS: usize = 24;
/// Steps of curves over the field.
const FIELD_STEPS: usize = 14;

/// Pixels and samples a pixel of the photograph.
const PICTURE: (&str, u32) = ("720x480", 64);

/// One page about the lens, for paper: drawing, first and third order, contrast, spots, fans, distortion, illumination, glasses, and, asked for,
/// what tolerances do to it and a photograph; -o FILE.html or FILE.pdf.
#[derive(clap::Args, Debug)]
pub struct Report {
    #[command(flatten)]
    bench: Bench,
    /// Tolerance sheet (.toml): the page says what builds of the lens are like.
    #[arg(long, value_name = "SHEET")]
    tolerances: Option<PathBuf>,
    /// Builds for that.
    #[arg(short = 'n', long, value_name = "N", default_value_t = 200, requires = "tolerances")]
    builds: usize,
    /// A photograph through the lens on the page: a name from `scene list`, such as the chart slanted-edges, or a file.
    #[arg(long, value_name = "SCENE")]
    photograph: Option<String>,
}

impl Report {
    pub(super) fn run(&self, global: &GlobalFlags) -> anyhow::Result<()> {
        let bench = &self.bench;
        let paths: Vec<&Path> = bench.output.iter().map(|p| p.as_path()).collect();
        if paths.is_empty() || paths.iter().any(|p| document::kind(p).is_none()) {
            return Err(UsageError(anyhow!("lens report: expected -o FILE.html or -o FILE.pdf")).into());
        }
        let read = [Path::new(&bench.lens)].into_iter().chain(self.tolerances.as_deref());
        distinct(read, paths.iter().copied())?;
        let outputs = paths.iter().map(|path| document::prepare(path)).collect::<Result<Vec<_>, _>>()?;
        let table = Table::new(bench)?;
        let mut page = page(&table);
        if let Some(sheet) = &self.tolerances {
            let (title, rows, lines) = tolerance::summary(sheet, &bench.lens, self.builds)?;
            page.heading("Tolerances");
            page.paragraph(&format!("{title}, by {}", sheet.display()));
            page.blocks.push(Block::Rows { rows, head: true });
            lines.iter().for_each(|line| page.paragraph(line));
        }
        if let Some(scene) = &self.photograph {
            photograph(&table, self, scene, global.threads, &mut page)?;
        }
        notes(&table, &mut page);
        for output in outputs {
            say(&format!("wrote {}", page.write(output)?.display()));
        }
        if global.json {
            print_json(&json!({ "files": paths, "fields_deg": table.fields, "wavelengths_nm": table.wavelengths }))?;
        }
        Ok(())
    }
}

/// The page. What a lens does not have (no light at a field, no dispersion) is left out of it.
fn page(table: &Table) -> Document {
    let p = &table.prescription;
    let mut out = Document { title: p.name.clone(), ..Document::default() };
    for line in [p.patent.as_deref(), Some(&p.source[..]).filter(|s| !s.is_empty())].into_iter().flatten() {
        out.paragraph(line);
    }
    section(&mut out, "Layout", [layout(table)]);
    out.heading("First order");
    out.blocks.push(Block::Rows { rows: first_order(table), head: false });
    out.heading("Prescription");
    out.blocks.push(Block::Rows { rows: prescription(table), head: true });
    out.heading("Third order");
    third_order(table, &mut out);
    section(&mut out, "Contrast (MTF)", contrast(table));
    let bench = table.bench();
    let at_each = |field: f64| -> Vec<_> {
        table.wavelengths.iter().filter_map(|nm| bench.spot(field, *nm, table.reference, SPOT_RAYS, 0.0)).collect()
    };
    let spots: Vec<_> = table.fields.iter().map(|f| at_each(*f)).filter(|s| !s.is_empty()).collect();
    section(&mut out, "Spots", [Spot::plot("", &spots)]);
    let fans: Vec<Vec<_>> = table
        .fields
        .iter()
        .map(|f| table.wavelengths.iter().filter_map(|nm| bench.fan(*f, *nm, table.reference, 32)).collect())
        .collect();
    section(&mut out, "Ray fans", [Fan::plot("", &fans)]);
    let most = table.largest_field();
    if most > 0.0 {
        let over = |steps: usize| (0..=steps).map(move |i| most * i as f64 / steps as f64);
        let points: Vec<_> = over(20).filter_map(|f| bench.field_point(f, table.reference)).collect();
        let height = points.last().map_or(0.0, |p| p.height.abs());
        section(&mut out, "Distortion and field curvature", [FieldPoint::plot("", &points)]);
        let light: Vec<_> = (0..=20).map(|i| bench.illumination(height * i as f64 / 20.0, table.reference)).collect();
        let beams: Vec<(f64, f64)> = over(FIELD_STEPS).filter_map(|f| Some((f, bench.vignetting(f, table.reference)?))).collect();
        let pupils: Vec<_> = table.fields.iter().filter_map(|f| bench.pupil_shape(*f, table.reference)).collect();
        section(&mut out, "Relative illumination", [Illumination::plot("", &light, &beams, &pupils)]);
    }
    let glasses: Vec<(String, Glass)> =
        p.surfaces.iter().enumerate().map(|(i, s)| ((i + 1).to_string(), s.glass.clone())).collect();
    if glasses.iter().any(|(_, g)| !matches!(g.kind, GlassKind::Air | GlassKind::Constant(_))) {
        let wavelengths: Vec<f64> = (0..=30).map(|i| 400.0 + 10.0 * i as f64).collect();
        let curves = bench.color(&wavelengths, table.reference, &table.fields);
        section(&mut out, "Colour", [curves.plot("")]);
        section(&mut out, "Glasses, by the surface before them", [draw::glass_map("", &glasses)]);
    }
    out
}

fn notes(table: &Table, out: &mut Document) {
    let p = &table.prescription;
    if !p.notes.is_empty() {
        out.heading("Notes");
        p.notes.iter().for_each(|note| out.paragraph(note));
    }
}

/// A photograph through the lens, by this program itself; the command that makes it stands below.
fn photograph(
    table: &Table,
    asked: &Report,
    scene: &str,
    threads: Option<NonZeroUsize>,
    out: &mut Document,
) -> anyhow::Result<()> {
    let folder = tempfile::tempdir().context("a temporary folder")?;
    let picture = folder.path().join("through.png");
    let (size, samples) = PICTURE;
    let mut typed = format!("shoot \"{scene}\" --lens \"{}\" --aperture f/{:.4}", asked.bench.lens, table.set.f_number);
    if table.prescription.zoom.len() > 1 {
        typed += &format!(" --focal-length {:.4}mm", table.set.efl);
    }
    typed += &format!(" --size {size} --spp {samples}");
    let program = OwnProgram::new(threads)?;
    program.run(&format!("{typed} -o \"{}\"", picture.display()), None)?;
    let bytes = std::fs::read(&picture).with_context(|| picture.display().to_string())?;
    out.heading("Photograph");
    out.blocks.push(Block::Picture { picture: paint::read_png(&bytes)?.into(), marked: None });
    out.blocks.push(Block::Small(format!("diopter {typed} -o through.png")));
    Ok(())
}

fn section(out: &mut Document, title: &str, figures: impl IntoIterator<Item = Figure>) {
    out.heading(title);
    out.blocks.push(Block::Figures(figures.into_iter().collect()));
}

fn first_order(table: &Table) -> Vec<Vec<String>> {
    let system = &table.set.system;
    let n = system.indices(table.reference);
    let mut f = FirstOrder::of(system, &n);
    // The pupils of the real axial beam.
    f.stop_radius = 0.5 * table.set.efl / table.set.f_number / f.entrance_pupil_magnification.abs();
    let axis = table.bench().illumination(0.0, table.reference);
    let mm = |v: f64| format!("{v:.4} mm");
    let mut rows = vec![
        ("wavelengths", table.wavelengths.iter().map(|nm| format!("{nm:.1}")).collect::<Vec<_>>().join(", ") + " nm"),
        ("reference", format!("{:.1} nm", table.reference)),
        ("focal length", mm(f.efl)),
        ("back focal length", mm(f.bfl)),
        ("front focal length", mm(f.ffl)),
        ("principal planes, z", format!("{:.4}, {:.4} mm", f.front_principal_z, f.rear_principal_z)),
        ("entrance pupil, z, diameter", format!("{:.4}, {:.4} mm", f.entrance_pupil_z, 2.0 * f.entrance_pupil_radius())),
        ("exit pupil, z, diameter", format!("{:.4}, {:.4} mm", f.exit_pupil_z, 2.0 * f.exit_pupil_radius())),
        ("f-number", format!("{:.4} (opens to {:.4})", table.f_number(), table.set.widest * table.dispersion_of_focal_length())),
    ];
    if axis.with_losses > 0.0 {
        // As bright on the axis as a lossless lens of this f-number.
        rows.push(("T-stop", format!("{:.4}", (std::f64::consts::PI / (4.0 * axis.with_losses)).sqrt())));
        rows.push(("transmittance", format!("{:.4}", axis.with_losses / axis.geometric)));
    }
    match table.object_distance {
        None => rows.push(("object", "at infinity".into())),
        Some(d) => {
            rows.push(("object before the first vertex", mm(d)));
            rows.push(("magnification", format!("{:.6}", -f.efl / (d + f.ffl))));
        }
    }
    rows.push(("film, z", mm(system.film_z)));
    rows.push(("Petzval radius", mm(1.0 / f.petzval_sum)));
    if let Some(circle) = table.prescription.image_circle {
        rows.push(("image circle", format!("{circle} mm")));
    }
    rows.into_iter().map(|(name, value)| vec![name.to_owned(), value]).collect()
}

fn prescription(table: &Table) -> Vec<Vec<String>> {
    let state = table.set.state;
    let head = ["", "radius, mm", "gap, mm", "semi-diameter, mm", "glass", ""].map(str::to_owned).to_vec();
    let mut rows = vec![head];
    for (i, s) in table.prescription.surfaces.iter().enumerate() {
        let radius = |c: f64| if c == 0.0 { "inf".to_owned() } else { format!("{:.4}", 1.0 / c) };
        let both = format!("{} / {}", radius(s.profile.curvature_x()), radius(s.profile.curvature()));
        let mut about: Vec<String> = vec![];
        about.extend(s.stop.then(|| "stop".into()));
        about.extend(s.mirror.then(|| "mirror".into()));
        match &s.profile {
            Profile::Conic { k, .. } => about.push(format!("conic {k}")),
            Profile::Asphere(a) => {
                about.extend((a.k != 0.0).then(|| format!("conic {}", a.k)));
                let terms = a.a.iter().enumerate().filter(|(_, v)| **v != 0.0);
                about.extend(terms.map(|(power, v)| format!("r^{power} {v:e}")));
            }
            Profile::Forbes(_) => about.push("Q-type asphere".into()),
            Profile::Freeform(_) => about.push("freeform (x / y)".into()),
            Profile::Fresnel(_) => about.push("Fresnel".into()),
            Profile::Toroid { .. } => about.push("toroid (x / y)".into()),
            Profile::Biconic { .. } => about.push("biconic (x / y)".into()),
            Profile::Plane | Profile::Sphere(_) => {}
        }
        about.extend(s.diffractive.as_ref().map(|d| format!("diffractive, order {}", d.order())));
        about.extend((s.obstruction > 0.0).then(|| format!("obstruction {}", s.obstruction)));
        about.extend((!s.apertures.is_empty()).then(|| "aperture".into()));
        about.extend((s.decenter != [0.0; 2] || s.tilt != [0.0; 3]).then(|| "decentred or tilted".into()));
        rows.push(vec![
            (i + 1).to_string(),
            if s.profile.is_rotational() { radius(s.profile.curvature()) } else { both },
            format!("{:.4}", s.gap.at(state.zoom, state.focus)),
            s.semi_diameter.map_or(String::new(), |sd| format!("{sd:.3}")),
            if s.glass.kind == GlassKind::Air { String::new() } else { s.glass.describe() },
            about.join(", "),
        ]);
    }
    rows
}

fn third_order(table: &Table, out: &mut Document) {
    let system = &table.set.system;
    if system.object_axis.is_some() {
        return out.paragraph("Not computed: the lens has no axis, but a base ray that surfaces turn.");
    }
    if system.has_gradients() {
        return out.paragraph("Not computed: the lens has gradient-index media.");
    }
    let n = system.indices(table.reference);
    let ends = table.wavelengths.iter().fold((f64::MAX, 0.0f64), |(a, b), nm| (a.min(*nm), b.max(*nm)));
    let dispersion: Vec<f64> = system.indices(ends.0).iter().zip(system.indices(ends.1)).map(|(a, b)| a - b).collect();
    let field = table.third_order_field();
    let height = 0.5 * table.set.efl / table.set.f_number;
    let third = ThirdOrder::of(system, &n, &dispersion, table.object_distance, height, field.to_radians().tan());
    let head = [
        "",
        "spherical",
        "tang. coma",
        "tang. astigm.",
        "sag. astigm.",
        "Petzval",
        "distortion",
        "axial colour",
        "lateral colour",
    ];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    let row = |name: String, values: [f64; 8]| {
        let mut row = vec![name];
        row.extend(values.map(|v| format!("{v:.6}")));
        row
    };
    rows.extend(third.surfaces.iter().enumerate().map(|(i, s)| row((i + 1).to_string(), third.transverse(s))));
    let sum = third.sum();
    rows.push(row("sum".into(), third.transverse(&sum)));
    let seidel = sum.seidel.map(|v| format!("{v:.6}")).join(", ");
    let round =
        if system.is_rotational() { "" } else { " The lens is not round: these are of its y–z section, tilts left out." };
    out.paragraph(&format!(
        "Transverse aberrations in mm at f/{:.2} and {field:.2}°. Seidel sums S1 to S5: {seidel} mm.{round}",
        table.f_number()
    ));
    out.blocks.push(Block::Rows { rows, head: true });
}

fn contrast(table: &Table) -> Vec<Figure> {
    let bench = table.bench();
    let colors: Vec<(f64, f64)> = table.wavelengths.iter().map(|nm| (*nm, 1.0)).collect();
    let steps: Vec<f64> = (0..=50).map(|i| HIGHEST * i as f64 / 50.0).collect();
    let curves: Vec<Mtf> = table.fields.iter().filter_map(|f| bench.diffraction_mtf(*f, &colors, &steps, 0.0)).collect();
    let limit: Vec<f64> = steps.iter().map(|f| airy_mtf(*f, table.reference, table.f_number())).collect();
    let mut out = vec![Mtf::plot("by frequency", &curves, Some(&limit))];
    let most = table.largest_field();
    if most > 0.0 {
        let over = (0..=FIELD_STEPS).map(|i| most * i as f64 / FIELD_STEPS as f64);
        let each: Vec<(f64, Mtf)> =
            over.filter_map(|f| Some((f, bench.diffraction_mtf(f, &colors, &FREQUENCIES, 0.0)?))).collect();
        out.push(Mtf::plot_over("by field", "field angle, degrees", &FREQUENCIES, &each));
    }
    // As far as the geometric blur at f/N covers a period of the lowest frequency.
    let depth = 0.5 * table.set.f_number / FREQUENCIES[0];
    let shown = fields_to(most);
    for field in if most > 0.0 { &shown[..2] } else { &shown[..1] } {
        let planes = (-12..=12).map(|i| depth * i as f64 / 12.0);
        let each: Vec<(f64, Mtf)> =
            planes.filter_map(|d| Some((d, bench.diffraction_mtf(*field, &colors, &FREQUENCIES, d)?))).collect();
        let title = format!("through focus, {field:.1}°");
        out.push(Mtf::plot_over(&title, "defocus, mm", &FREQUENCIES, &each));
    }
    out
}
