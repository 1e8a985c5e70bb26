//! The plots of the analyses.

use super::chart::{Axis, Chart, Line, Style};
use super::figure::{Anchor, Color, Figure};
use super::layout::FIELD_COLORS;
use crate::analysis::{ColorCurves, Fan, FieldPoint, Illumination, Mtf, PupilShape, Spot};
use glam::DVec2;

/// A colour that stands for a wavelength (nm): hue only, dark enough for paper.
pub fn wavelength_color(nm: f64) -> Color {
    match nm {
        ..430.0 => [110, 50, 160],
        ..500.0 => [40, 80, 200],
        ..530.0 => [0, 140, 120],
        ..590.0 => [40, 150, 40],
        ..620.0 => [210, 140, 0],
        _ => [200, 40, 40],
    }
}

fn sheet(title: &str, columns: usize, rows: usize, cell: DVec2) -> Figure {
    let mut figure = Figure::new(cell.x * columns as f64, cell.y * rows as f64 + 24.0);
    figure.text(DVec2::new(figure.width / 2.0, 16.0), title, 11.0, Anchor::Middle);
    figure
}

fn line(name: String, color: Color, style: Style, points: Vec<DVec2>) -> Line {
    Line { name, color, style, points }
}

/// Spot diagrams: a square a field, colours together, in µm around the centroid of the first colour.
pub fn spot_plot(title: &str, fields: &[Vec<Spot>]) -> Figure {
    spot_squares(title, &[fields.iter().map(|spots| (String::new(), spots.clone())).collect()])
}

/// Spot diagrams through focus: a row a field, its spots with the defocus (mm) of each square.
pub fn through_focus_plot(title: &str, fields: &[Vec<(f64, Vec<Spot>)>]) -> Figure {
    let label = |(defocus, spots): &(f64, Vec<Spot>)| (format!("{defocus:+.3} mm: "), spots.clone());
    let rows: Vec<Vec<_>> = fields.iter().map(|row| row.iter().map(label).collect()).collect();
    spot_squares(title, &rows)
}

/// Squares with a label each, all in one scale.
fn spot_squares(title: &str, rows: &[Vec<(String, Vec<Spot>)>]) -> Figure {
    let cell = DVec2::new(230.0, 240.0);
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0).max(1);
    let mut figure = sheet(title, columns, rows.len().max(1), cell);
    let all = rows.iter().flatten().flat_map(|(_, spots)| spots.iter());
    let reach = all.flat_map(|s| s.points.iter().map(|p| p.distance(s.centroid))).fold(1e-4, f64::max) * 1.1e3;
    let squares = rows.iter().enumerate().flat_map(|(j, row)| row.iter().enumerate().map(move |(i, square)| (i, j, square)));
    for (i, j, (label, spots)) in squares {
        let Some(first) = spots.first() else { continue };
        let at = |p: &DVec2| (*p - first.centroid) * 1e3;
        let lines = spots
            .iter()
            .map(|s| line(format!("{:.0} nm", s.nm), wavelength_color(s.nm), Style::Dots, s.points.iter().map(at).collect()))
            .collect();
        let axis = |label: &str| Axis { label: label.into(), range: [-reach, reach] };
        let rms = spots.iter().map(|s| s.rms).fold(0.0, f64::max) * 1e3;
        let title = format!("{label}{:.1}°, {:.2} mm, RMS {rms:.1} µm", first.field_deg, first.centroid.y);
        let chart = Chart { title, x: axis("x, µm"), y: axis("y, µm"), lines };
        chart.draw(&mut figure, DVec2::new(cell.x * i as f64, 24.0 + cell.y * j as f64), cell);
    }
    figure
}

/// Ray fans: tangential and sagittal transverse errors in µm, and the wavefront, a row a field.
pub fn fan_plot(title: &str, fields: &[Vec<Fan>]) -> Figure {
    let cell = DVec2::new(270.0, 190.0);
    let mut figure = sheet(title, 3, fields.len().max(1), cell);
    let all = || fields.iter().flatten();
    let errors =
        all().flat_map(|f| f.tangential.iter().map(|p| p.error.y * 1e3).chain(f.sagittal.iter().map(|p| p.error.x * 1e3)));
    let waves = all().flat_map(|f| f.tangential.iter().chain(&f.sagittal).map(|p| p.opd));
    let error_axis = Axis::around("transverse error, µm", errors, true);
    let wave_axis = Axis::around("path difference, waves", waves, true);
    for (row, fans) in fields.iter().enumerate() {
        let pupil = Axis { label: "relative pupil".into(), range: [-1.1, 1.1] };
        let kinds: [(&str, &Axis); 3] =
            [("tangential", &error_axis), ("sagittal", &error_axis), ("wavefront (full: tangential)", &wave_axis)];
        for (column, (kind, y)) in kinds.into_iter().enumerate() {
            let mut lines = vec![];
            for f in fans {
                let color = wavelength_color(f.nm);
                let name = if row == 0 && column == 0 { format!("{:.0} nm", f.nm) } else { String::new() };
                let points = |p: &[crate::analysis::FanPoint], value: &dyn Fn(&crate::analysis::FanPoint) -> f64| {
                    p.iter().map(|p| DVec2::new(p.pupil, value(p))).collect::<Vec<_>>()
                };
                match column {
                    0 => lines.push(line(name, color, Style::Full, points(&f.tangential, &|p| p.error.y * 1e3))),
                    1 => lines.push(line(name, color, Style::Full, points(&f.sagittal, &|p| p.error.x * 1e3))),
                    _ => {
                        lines.push(line(name, color, Style::Full, points(&f.tangential, &|p| p.opd)));
                        lines.push(line(String::new(), color, Style::Broken, points(&f.sagittal, &|p| p.opd)));
                    }
                }
            }
            let field = fans.first().map_or(0.0, |f| f.field_deg);
            let chart = Chart { title: format!("{field:.1}° {kind}"), x: pupil.clone(), y: y.clone(), lines };
            chart.draw(&mut figure, DVec2::new(cell.x * column as f64, 24.0 + cell.y * row as f64), cell);
        }
    }
    figure
}

/// What is plotted of the image of a point, in µm from the chief ray (of the energy: from the centroid).
#[derive(Clone, Debug, PartialEq)]
pub struct PointImageCurves {
    /// For the legend.
    pub name: String,
    /// Radius, fraction of the light within.
    pub energy: Vec<DVec2>,
    /// Place, line spread of its largest; tangential, sagittal.
    pub line: [Vec<DVec2>; 2],
    /// Place, light of an edge; tangential, sagittal.
    pub edge: [Vec<DVec2>; 2],
}

/// Encircled energy, line and edge spread: a colour an image, tangential full, sagittal broken.
pub fn psf_plot(title: &str, images: &[PointImageCurves]) -> Figure {
    let cell = DVec2::new(330.0, 280.0);
    let mut figure = sheet(title, 3, 1, cell);
    let color = |i: usize| FIELD_COLORS[i % FIELD_COLORS.len()];
    let one = |label: &str| Axis { label: label.into(), range: [0.0, 1.05] };
    let energy: Vec<Line> =
        images.iter().enumerate().map(|(i, c)| line(c.name.clone(), color(i), Style::Full, c.energy.clone())).collect();
    let x = Axis::around("radius, µm", energy.iter().flat_map(|l| l.points.iter().map(|p| p.x)), true);
    Chart { title: "encircled energy".into(), x, y: one("fraction of the light"), lines: energy }.draw(
        &mut figure,
        DVec2::new(0.0, 24.0),
        cell,
    );
    let spread = |curves: &dyn Fn(&PointImageCurves) -> &[Vec<DVec2>; 2]| {
        let both = |(i, c): (usize, &PointImageCurves)| {
            let [tangential, sagittal] = curves(c).clone();
            [line(c.name.clone(), color(i), Style::Full, tangential), line(String::new(), color(i), Style::Broken, sagittal)]
        };
        images.iter().enumerate().flat_map(both).collect::<Vec<_>>()
    };
    let charts = [
        ("line spread (full: tangential)", "of its largest", spread(&|c| &c.line)),
        ("edge spread (full: tangential)", "fraction of the light", spread(&|c| &c.edge)),
    ];
    for (i, (title, label, lines)) in charts.into_iter().enumerate() {
        let x = Axis::around("from the chief ray, µm", lines.iter().flat_map(|l| l.points.iter().map(|p| p.x)), true);
        let at = DVec2::new(cell.x * (i + 1) as f64, 24.0);
        Chart { title: title.into(), x, y: one(label), lines }.draw(&mut figure, at, cell);
    }
    figure
}

/// Zernike coefficients (waves) over their number: a colour a wavefront.
pub fn zernike_plot(title: &str, wavefronts: &[(String, Vec<f64>)]) -> Figure {
    let cell = DVec2::new(560.0, 340.0);
    let mut figure = sheet(title, 1, 1, cell);
    let points = |c: &[f64]| c.iter().enumerate().map(|(k, c)| DVec2::new((k + 1) as f64, *c)).collect::<Vec<_>>();
    let curve = |(i, (name, c)): (usize, &(String, Vec<f64>))| {
        line(name.clone(), FIELD_COLORS[i % FIELD_COLORS.len()], Style::Full, points(c))
    };
    let lines: Vec<Line> = wavefronts.iter().enumerate().map(curve).collect();
    let x = Axis::around("number of the term", lines.iter().flat_map(|l| l.points.iter().map(|p| p.x)), true);
    let y = Axis::around("coefficient, waves", lines.iter().flat_map(|l| l.points.iter().map(|p| p.y)), true);
    Chart { title: String::new(), x, y, lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
    figure
}

/// Contrast over frequency: a colour a field, tangential full, sagittal broken.
pub fn mtf_plot(title: &str, curves: &[Mtf], limit: Option<&[f64]>) -> Figure {
    let cell = DVec2::new(560.0, 340.0);
    let mut figure = sheet(title, 1, 1, cell);
    let mut lines = vec![];
    if let (Some(limit), Some(first)) = (limit, curves.first()) {
        let points = first.frequencies.iter().zip(limit).map(|(f, m)| DVec2::new(*f, *m)).collect();
        lines.push(line("diffraction limit".into(), [150, 150, 150], Style::Full, points));
    }
    for (i, m) in curves.iter().enumerate() {
        let color = FIELD_COLORS[i % FIELD_COLORS.len()];
        let points = |v: &[f64]| m.frequencies.iter().zip(v).map(|(f, m)| DVec2::new(*f, *m)).collect::<Vec<_>>();
        let kind = if m.geometric { ", geometric" } else { "" };
        lines.push(line(format!("{:.1}° tangential{kind}", m.field_deg), color, Style::Full, points(&m.tangential)));
        lines.push(line(format!("{:.1}° sagittal{kind}", m.field_deg), color, Style::Broken, points(&m.sagittal)));
    }
    let highest = curves.first().and_then(|m| m.frequencies.last()).copied().unwrap_or(1.0);
    let x = Axis { label: "spatial frequency, cycles/mm".into(), range: [0.0, highest] };
    let y = Axis { label: "contrast".into(), range: [0.0, 1.0] };
    Chart { title: String::new(), x, y, lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
    figure
}

/// Contrast at some frequencies over a field angle or a defocus: a colour a frequency, tangential full, sagittal broken.
pub fn mtf_over_plot(title: &str, label: &str, frequencies: &[f64], curves: &[(f64, Mtf)]) -> Figure {
    let cell = DVec2::new(560.0, 340.0);
    let mut figure = sheet(title, 1, 1, cell);
    let mut lines = vec![];
    for (i, f) in frequencies.iter().enumerate() {
        let color = FIELD_COLORS[i % FIELD_COLORS.len()];
        let points = |v: &dyn Fn(&Mtf) -> f64| curves.iter().map(|(x, m)| DVec2::new(*x, v(m))).collect::<Vec<_>>();
        lines.push(line(format!("{f:.0}/mm tangential"), color, Style::Full, points(&|m| m.tangential[i])));
        lines.push(line(format!("{f:.0}/mm sagittal"), color, Style::Broken, points(&|m| m.sagittal[i])));
    }
    let ends = [curves.first().map_or(0.0, |c| c.0), curves.last().map_or(1.0, |c| c.0)];
    let range = if ends[1] > ends[0] { ends } else { [ends[0] - 1.0, ends[0] + 1.0] };
    let x = Axis { label: label.into(), range };
    let y = Axis { label: "contrast".into(), range: [0.0, 1.0] };
    Chart { title: String::new(), x, y, lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
    figure
}

/// Distortion and field curvature over the field.
pub fn distortion_plot(title: &str, points: &[FieldPoint]) -> Figure {
    let cell = DVec2::new(300.0, 330.0);
    let mut figure = sheet(title, 2, 1, cell);
    let field = Axis { label: "field angle, degrees".into(), range: [0.0, points.last().map_or(1.0, |p| p.field_deg)] };
    let over = |value: &dyn Fn(&FieldPoint) -> f64| points.iter().map(|p| DVec2::new(value(p), p.field_deg)).collect::<Vec<_>>();
    // Against f tan θ there is none from 90° on; a lens that is nearer to f θ (a fisheye) is held against that too.
    let finite = |points: Vec<DVec2>| points.into_iter().filter(|p| p.x.is_finite()).collect::<Vec<_>>();
    let (rectilinear, equidistant) = (finite(over(&|p| p.distortion_percent())), finite(over(&|p| p.equidistant_percent())));
    let edge = |v: &[DVec2]| v.last().map_or(0.0, |p| p.x.abs());
    let beyond = points.iter().any(|p| p.ideal_height.is_nan());
    let fisheye = beyond || edge(&rectilinear) > edge(&equidistant).max(5.0);
    let (shown, label) = if fisheye { (equidistant.clone(), "departure, %") } else { (rectilinear.clone(), "distortion, %") };
    let reach = if fisheye { shown.iter().chain(&rectilinear) } else { shown.iter().chain(&shown[..0]) };
    let x = Axis::around(label, reach.map(|p| p.x), true);
    let lines = match fisheye {
        false => vec![line(String::new(), FIELD_COLORS[0], Style::Full, rectilinear)],
        true => vec![
            line("from f θ".into(), FIELD_COLORS[0], Style::Full, equidistant),
            line("from f tan θ".into(), FIELD_COLORS[2], Style::Broken, rectilinear),
        ],
    };
    Chart { title: "distortion".into(), x, y: field.clone(), lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
    let (t, s) = (over(&|p| p.focus[0]), over(&|p| p.focus[1]));
    let x = Axis::around("focus behind the film, mm", t.iter().chain(&s).map(|p| p.x), true);
    let lines = vec![
        line("tangential".into(), FIELD_COLORS[2], Style::Full, t),
        line("sagittal".into(), FIELD_COLORS[0], Style::Broken, s),
    ];
    Chart { title: "field curvature".into(), x, y: field, lines }.draw(&mut figure, DVec2::new(cell.x, 24.0), cell);
    figure
}

/// Relative illumination over the film, mechanical vignetting over the field, and the entrance pupil as fields see it.
pub fn vignetting_plot(title: &str, light: &[Illumination], vignetting: &[(f64, f64)], pupils: &[PupilShape]) -> Figure {
    let cell = DVec2::new(300.0, 300.0);
    let mut figure = sheet(title, 3, 1, cell);
    let reach = pupils.iter().flat_map(|p| p.entrance.iter().map(|p| p.abs().max_element())).fold(1e-9, f64::max) * 1.1;
    let outlines = pupils
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let closed = p.entrance.iter().chain(p.entrance.first()).copied().collect();
            line(format!("{:.1}°", p.field_deg), FIELD_COLORS[i % FIELD_COLORS.len()], Style::Full, closed)
        })
        .collect();
    let axis = |label: &str| Axis { label: label.into(), range: [-reach, reach] };
    Chart { title: "entrance pupil".into(), x: axis("sagittal, mm"), y: axis("tangential, mm"), lines: outlines }.draw(
        &mut figure,
        DVec2::new(2.0 * cell.x, 24.0),
        cell,
    );
    let y = Axis { label: "fraction of the axis".into(), range: [0.0, 1.05] };
    let axis = light.first().copied().unwrap_or(Illumination { height: 0.0, geometric: 1.0, with_losses: 1.0 });
    let over = |value: &dyn Fn(&Illumination) -> f64| light.iter().map(|l| DVec2::new(l.height, value(l))).collect::<Vec<_>>();
    let lines = vec![
        line("illumination".into(), FIELD_COLORS[0], Style::Full, over(&|l| l.geometric / axis.geometric.max(1e-300))),
        line("with losses".into(), FIELD_COLORS[2], Style::Broken, over(&|l| l.with_losses / axis.with_losses.max(1e-300))),
    ];
    let x = Axis { label: "image height, mm".into(), range: [0.0, light.last().map_or(1.0, |l| l.height)] };
    Chart { title: "relative illumination".into(), x, y: y.clone(), lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
    let points = vignetting.iter().map(|(f, v)| DVec2::new(*f, *v)).collect();
    let lines = vec![line(String::new(), FIELD_COLORS[1], Style::Full, points)];
    let x = Axis { label: "field angle, degrees".into(), range: [0.0, vignetting.last().map_or(1.0, |v| v.0)] };
    Chart { title: "beam area across the chief ray".into(), x, y, lines }.draw(&mut figure, DVec2::new(cell.x, 24.0), cell);
    figure
}

/// Axial and lateral colour over wavelength.
pub fn color_plot(title: &str, curves: &ColorCurves) -> Figure {
    let cell = DVec2::new(330.0, 280.0);
    let mut figure = sheet(title, 2, 1, cell);
    let (first, last) =
        (curves.wavelengths.first().copied().unwrap_or(400.0), curves.wavelengths.last().copied().unwrap_or(700.0));
    let x = Axis { label: "wavelength, nm".into(), range: [first, last] };
    let over =
        |v: &[f64], scale: f64| curves.wavelengths.iter().zip(v).map(|(w, v)| DVec2::new(*w, *v * scale)).collect::<Vec<_>>();
    let axial = over(&curves.axial, 1.0);
    let y = Axis::around("paraxial focus, mm", axial.iter().map(|p| p.y), true);
    let lines = vec![line(String::new(), FIELD_COLORS[0], Style::Full, axial)];
    Chart { title: "axial colour".into(), x: x.clone(), y, lines }.draw(&mut figure, DVec2::new(0.0, 24.0), cell);
    let lines: Vec<Line> = curves
        .lateral
        .iter()
        .enumerate()
        .map(|(i, (field, v))| line(format!("{field:.1}°"), FIELD_COLORS[i % FIELD_COLORS.len()], Style::Full, over(v, 1e3)))
        .collect();
    let y = Axis::around("image height, µm", lines.iter().flat_map(|l| l.points.iter().map(|p| p.y)), true);
    Chart { title: "lateral colour".into(), x, y, lines }.draw(&mut figure, DVec2::new(cell.x, 24.0), cell);
    figure
}
