//! The glass map: refractive index over Abbe number, which runs to the left as in the charts of glass makers.

use super::figure::{Anchor, Color, Figure, GRID, INK, Item};
use crate::glass::{self, D_NM, Glass, GlassKind};
use glam::DVec2;

const CATALOGUE: Color = [190, 198, 206];
const MARKED: Color = [200, 40, 40];
/// Abbe numbers at the left and at the right edge.
const ABBE: [f64; 2] = [100.0, 15.0];
/// Indices at the bottom and at the top.
const INDEX: [f64; 2] = [1.4, 2.1];

/// Abbe number and index of a glass that has dispersion figures.
fn place(glass: &Glass) -> Option<DVec2> {
    let at = DVec2::new(glass.abbe(), glass.index(D_NM));
    let known = !matches!(glass.kind, GlassKind::Air | GlassKind::Constant(_));
    let inside = (ABBE[1]..=ABBE[0]).contains(&at.x) && (INDEX[0]..=INDEX[1]).contains(&at.y);
    (known && inside).then_some(at)
}

/// The catalogue's glasses as grey dots, those of a lens marked with a label (what, glass). Glasses without dispersion, and those beyond
/// the map's edges, are left out.
pub fn glass_map(title: &str, marked: &[(String, Glass)]) -> Figure {
    let mut figure = Figure::new(560.0, 420.0);
    let (left, right, top, bottom) = (52.0, 548.0, 30.0, 384.0);
    let map = |p: DVec2| {
        let u = (p.x - ABBE[0]) / (ABBE[1] - ABBE[0]);
        let v = (p.y - INDEX[0]) / (INDEX[1] - INDEX[0]);
        DVec2::new(left + u * (right - left), bottom - v * (bottom - top))
    };
    figure.text(DVec2::new(280.0, 16.0), title, 11.0, Anchor::Middle);
    for abbe in (20..=100).step_by(10) {
        let x = map(DVec2::new(f64::from(abbe), 0.0)).x;
        figure.line([DVec2::new(x, top), DVec2::new(x, bottom)], GRID, 0.5, 0.0);
        figure.text(DVec2::new(x, bottom + 12.0), abbe.to_string(), 8.5, Anchor::Middle);
    }
    for tenth in 14..=21 {
        let index = f64::from(tenth) / 10.0;
        let y = map(DVec2::new(0.0, index)).y;
        figure.line([DVec2::new(left, y), DVec2::new(right, y)], GRID, 0.5, 0.0);
        figure.text(DVec2::new(left - 4.0, y + 3.0), format!("{index:.1}"), 8.5, Anchor::End);
    }
    let corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)];
    figure.line(corners.map(|(x, y)| DVec2::new(x, y)), INK, 0.8, 0.0);
    figure.text(DVec2::new(300.0, bottom + 28.0), "Abbe number Vd", 9.0, Anchor::Middle);
    let (at, text) = (DVec2::new(14.0, 0.5 * (top + bottom)), "index nd".into());
    figure.items.push(Item::Text { at, text, size: 9.0, anchor: Anchor::Middle, upwards: true, color: INK });
    let catalogue = glass::entry_names();
    for at in catalogue.iter().filter_map(|name| place(&glass::find(name, &[]).ok()?)) {
        figure.items.push(Item::Dot { at: map(at), radius: 1.1, color: CATALOGUE });
    }
    // One mark a glass, with the names of all that are made of it.
    let mut marks: Vec<(DVec2, String)> = vec![];
    for (label, glass) in marked {
        let Some(at) = place(glass) else { continue };
        match marks.iter_mut().find(|m| m.0 == at) {
            Some(mark) => mark.1 += &format!(", {label}"),
            None => marks.push((at, label.clone())),
        }
    }
    for (at, label) in marks {
        let at = map(at);
        figure.items.push(Item::Dot { at, radius: 3.2, color: MARKED });
        figure.text(at + DVec2::new(5.0, -3.0), label, 8.5, Anchor::Start);
    }
    figure
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flint_lies_right_of_crown_and_above() {
        let glasses = [("1", "N-BK7"), ("3", "N-SF11"), ("5", "N-BK7"), ("7", "1.5")];
        let marked: Vec<_> = glasses.iter().map(|(n, g)| ((*n).to_owned(), Glass::parse(g).unwrap())).collect();
        let figure = glass_map("t", &marked);
        let dots = |wanted: Color| -> Vec<DVec2> {
            let of = |i: &Item| match i {
                Item::Dot { at, color, .. } if *color == wanted => Some(*at),
                _ => None,
            };
            figure.items.iter().filter_map(of).collect()
        };
        // A constant index has no Abbe number; the same glass twice is one mark.
        let marks = dots(MARKED);
        assert_eq!(marks.len(), 2);
        assert!(marks[1].x > marks[0].x && marks[1].y < marks[0].y);
        // N-BK7: Vd 64.17, nd 1.5168.
        let expected = DVec2::new(52.0 + 496.0 * (100.0 - 64.17) / 85.0, 384.0 - 354.0 * 0.1168 / 0.7);
        assert!((marks[0] - expected).length() < 0.1, "{} {expected}", marks[0]);
        assert!(dots(CATALOGUE).len() > 300);
        assert!(figure.to_svg().contains(">1, 5<"));
    }
}
