//! Spectral responses of a data sheet: read from the sheet or by name, behind the filter before the sensor.

use super::Checks;
use crate::data::RESPONSES;
use crate::{SensorError, nearest};
use diopter_image::Cfa;
use diopter_image::raw::Filter;
use diopter_light::spectrum::Table;
use serde::Deserialize;

/// Wavelengths (nm) that a response must cover.
const VISIBLE_NM: [f32; 2] = [400.0, 700.0];

#[derive(Deserialize)]
#[serde(untagged)]
pub(super) enum Response {
    Named(String),
    Inline(InlineResponse),
}

/// Relative sensitivities at equal steps; a monochrome sensor gives `Y` alone, one behind polarisers too, one with clear pixels `W` too.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)]
pub(super) struct InlineResponse {
    first_nm: f32,
    step_nm: f32,
    R: Option<Vec<f32>>,
    G: Option<Vec<f32>>,
    B: Option<Vec<f32>>,
    W: Option<Vec<f32>>,
    Y: Option<Vec<f32>>,
}

/// Transmittance of a filter before the sensor at equal steps.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Curve {
    first_nm: f32,
    step_nm: f32,
    transmittance: Vec<f32>,
}

/// Responses behind a filter, every nm from 380 to 780; nothing where nothing was measured.
pub(super) fn through(responses: Vec<Measured>, filter: Option<Curve>, check: &Checks) -> Result<Vec<Table>, SensorError> {
    let filter = match filter {
        None => Measured { first_nm: 0.0, last_nm: 1e4, curve: Table::new(0.0, 1e4, vec![1.0, 1.0]) },
        Some(f) => {
            let fine = f.step_nm > 0.0 && !f.transmittance.is_empty() && f.transmittance.iter().all(|t| (0.0..=1.0).contains(t));
            check.that(fine, "filter", "its curve", "step_nm above 0 and transmittances from 0 to 1")?;
            let measured = Measured::new(f.first_nm, f.step_nm, f.transmittance);
            covers(&measured, "filter", check.place)?;
            measured
        }
    };
    let behind = |r: &Measured| Table::new(380.0, 1.0, (380..=780).map(|nm| r.at(nm as f32) * filter.at(nm as f32)).collect());
    Ok(responses.iter().map(behind).collect())
}

/// A curve and where it was measured.
pub(super) struct Measured {
    first_nm: f32,
    last_nm: f32,
    curve: Table,
}

impl Measured {
    fn new(first_nm: f32, step_nm: f32, values: Vec<f32>) -> Self {
        let last_nm = first_nm + step_nm * (values.len() - 1) as f32;
        Measured { first_nm, last_nm, curve: Table::new(first_nm, step_nm, values) }
    }

    fn at(&self, nm: f32) -> f32 {
        if (self.first_nm..=self.last_nm).contains(&nm) { self.curve.at(nm) } else { 0.0 }
    }
}

fn covers(curve: &Measured, what: &str, place: &str) -> Result<(), SensorError> {
    let (first, last) = (curve.first_nm, curve.last_nm);
    match first <= VISIBLE_NM[0] && last >= VISIBLE_NM[1] {
        true => Ok(()),
        false => Err(SensorError::Range {
            what: format!("{place}: {what}"),
            found: format!("{first} to {last} nm"),
            expected: format!("{} to {} nm at least: write zeros where nothing is seen", VISIBLE_NM[0], VISIBLE_NM[1]),
        }),
    }
}

pub(super) fn relative_responses(response: Response, cfa: &Cfa, place: &str) -> Result<Vec<Measured>, SensorError> {
    let needed = cfa.channel_names();
    match response {
        Response::Named(name) => {
            let Some((_, csv)) = RESPONSES.iter().find(|r| r.0 == name) else {
                let known: Vec<&str> = RESPONSES.iter().map(|r| r.0).collect();
                let hint =
                    nearest(&name, known.iter().copied()).map_or(String::new(), |near| format!(" (did you mean \"{near}\"?)"));
                return Err(SensorError::Range {
                    what: format!("{place}: response"),
                    found: format!("\"{name}\""),
                    expected: format!(
                        "curves of your own, {{ first_nm = 400, step_nm = 10, {} = [...] }}, or one of {}{hint}",
                        needed.join(" = [...], "),
                        known.join(", ")
                    ),
                });
            };
            let (_, rows) = diopter_light::cie::tables::read_csv(csv);
            let columns = rows.first().map_or(0, |r| r.len());
            let first = rows.first().map_or(380.0, |r| r[0] as f32);
            let step = rows.get(1).map_or(5.0, |r| r[0] as f32 - first);
            let column = |c: usize| Measured::new(first, step, rows.iter().map(|r| (r[c] as f32).max(0.0)).collect());
            // What a pixel without filter sees of a colour camera: the sum of its filters, which hardly overlap.
            let clear = || {
                let sum = |r: &Vec<f64>| r[1..].iter().sum::<f64>().max(0.0) as f32;
                Measured::new(first, step, rows.iter().map(sum).collect())
            };
            cfa.filters()
                .iter()
                .map(|f| match (columns, f) {
                    (2, f) if !f.is_colored() => Ok(column(1)),
                    (4, Filter::Red) => Ok(column(1)),
                    (4, Filter::Green) => Ok(column(2)),
                    (4, Filter::Blue) => Ok(column(3)),
                    (4, Filter::Clear) => Ok(clear()),
                    _ => Err(SensorError::Range {
                        what: format!("{place}: response"),
                        found: format!("\"{name}\" of a monochrome sensor"),
                        expected: format!("curves for {}", needed.join(", ")),
                    }),
                })
                .collect()
        }
        Response::Inline(r) => {
            let lists = [("R", &r.R), ("G", &r.G), ("B", &r.B), ("W", &r.W), ("Y", &r.Y)];
            let missing = |what: String| SensorError::Range {
                what: format!("{place}: response"),
                found: "incomplete".into(),
                expected: format!("{what}, each with one or more numbers that are not negative, and a positive step_nm"),
            };
            if !(r.step_nm > 0.0 && r.first_nm.is_finite()) {
                return Err(missing(needed.join(", ")));
            }
            let curve = |name: &&str| {
                let (_, list) = lists.iter().find(|l| l.0 == *name)?;
                let list = list.as_ref().filter(|l| !l.is_empty() && l.iter().all(|v| v.is_finite() && *v >= 0.0))?;
                Some(list.clone())
            };
            let mut tables = Vec::new();
            for name in &needed {
                // Polarisers are all alike; `Y` is what pixels see of unpolarised light through them.
                let list = curve(if name.starts_with('P') { &"Y" } else { name });
                let list = list.ok_or_else(|| missing(if cfa.tells_polarization() { "Y".into() } else { needed.join(", ") }))?;
                let curve = Measured::new(r.first_nm, r.step_nm, list);
                covers(&curve, &format!("response {name}"), place)?;
                tables.push(curve);
            }
            Ok(tables)
        }
    }
}
