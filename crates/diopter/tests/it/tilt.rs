//! Tilted lenses together with the meter, autofocus and truth channels, against closed forms.

use crate::common::{Pattern, cards};
use diopter::expose::ProgressReporter;
use diopter::focus::zones_named;
use diopter::image::FocalPlane;
use diopter::lens::Lens;
use diopter::scene::material::{Material, Scattering};
use diopter::scene::shape::Quad;
use diopter::scene::texture::Color;
use diopter::scene::{Description, Object, Shape};
use diopter::shot::{Inputs, Shot, ShotFile};
use glam::{DVec3, Vec3};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

const COLUMNS: usize = 96;
const ROWS: usize = 64;
/// mm.
const PIXEL: f64 = 24.0 / ROWS as f64;
const F_NUMBER: f64 = 2.8;

fn shot(lens: &str, tilt_deg: f64, focus: &str, channels: &str, scene: Description) -> Shot {
    let toml = format!(
        "[camera]\nlook_from = [0, 0, 0]\nlook_at = [0, 0, -1]\nlens = \"{lens}\"\nbody = \"imx455\"\nformat = \"36x24\"\n\
         tilt_deg = [{tilt_deg}, 0]\n{}\
         [exposure]\nmode = \"A\"\naperture = \"f/{F_NUMBER}\"\niso = 390\nmetering = \"spot\"\n[focus]\ndistance = \"{focus}\"\n\
         [render]\nsize = \"{COLUMNS}x{ROWS}\"\nspp = 16\nintegrator = \"path\"\ndenoise = false\ntruth_channels = \"{channels}\"\n",
        if lens == "thin" { "focal_length = \"50mm\"\n" } else { "" }
    );
    let file: ShotFile = toml::from_str(&toml).unwrap();
    Shot::prepare_with(&file, Inputs { scene: Some(Arc::new(scene)), ..Inputs::default() }, &mut |_| ()).unwrap()
}

/// Focused, metered and exposed; with what autofocus found, m.
fn taken(mut shot: Shot) -> (Shot, FocalPlane, Option<f64>) {
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let report = shot.focus(&watch, &mut |_| ()).unwrap();
    shot.meter(&watch, &mut |_| ()).unwrap();
    let plane = shot.expose(&watch).unwrap();
    let found = report.map(|r| {
        assert_eq!(r.failure(), None);
        r.distance_m.unwrap()
    });
    (shot, plane, found)
}

/// Mean electrons in the middle of the picture.
fn middle(plane: &FocalPlane) -> f64 {
    let rows = ROWS / 2 - 2..ROWS / 2 + 2;
    let places = rows.flat_map(|y| (COLUMNS / 2 - 2..COLUMNS / 2 + 2).map(move |x| (x, y)));
    places.map(|(x, y)| f64::from(plane.mean.pixel(x, y)[0])).sum::<f64>() / 16.0
}

/// Circles of confusion down the middle column, px.
fn circles(plane: &FocalPlane) -> Vec<f64> {
    let coc = plane.truth.float("coc").unwrap();
    (0..ROWS).map(|y| f64::from(coc.pixel(COLUMNS / 2, y)[0])).collect()
}

#[test]
fn the_meter_gives_a_tilted_lens_the_light_that_its_pupil_loses() {
    // An even sky. Of a thin lens the film stands v = 1 / (1/f − 1/(s cos τ)) / cos τ from its middle, where a point of the axis at the distance s is sharp; from there
    // the pupil is foreshortened by cos τ.
    let film = |cosine: f64| 1.0 / (1.0 / 0.05 - 1.0 / (2.0 * cosine)) / cosine;
    let sky = || cards(&[(Pattern::Wall, 50.0, [-0.001, 0.001, -0.001, 0.001])], 12.0, 50.0).description().clone();
    for (lens, tilt) in [("thin", 30.0f64), ("double-gauss-50mm", 12.0)] {
        let [plain, tilted] = [0.0, tilt].map(|tilt| taken(shot(lens, tilt, "2 m", "", sky())));
        let time = tilted.0.facts().exposure_s / plain.0.facts().exposure_s;
        let light = middle(&tilted.1) / middle(&plain.1);
        let cosine = tilt.to_radians().cos();
        let expected = (film(cosine) / film(1.0)).powi(2) / cosine;
        println!("{lens}: {time:.4} times as long (thin: {expected:.4}), {light:.4} of the light");
        // What was metered lands on the film as without the tilt; the spot is wider than what is looked at here, and its probes have noise.
        assert!((light - 1.0).abs() < 0.02, "{lens}: {light}");
        match lens {
            "thin" => assert!((time / expected - 1.0).abs() < 0.01, "{lens}: {time} {expected}"),
            // Pupils lie elsewhere than principal points do, and rims cut in.
            _ => assert!(time > 1.0 + 0.5 * (expected - 1.0), "{lens}: {time} {expected}"),
        }
    }
}

#[test]
fn autofocus_through_a_tilted_lens_makes_the_middle_sharp_and_the_truth_shows_the_rest() {
    let distance = 1.5;
    let tilt = 6.0f64;
    for lens in ["thin", "double-gauss-50mm"] {
        let card = cards(&[(Pattern::Rough, distance, [-1.2, 1.2, -1.2, 1.2])], 12.0, 50.0).description().clone();
        let (_, plane, found) = taken(shot(lens, tilt, "auto", "coc,position", card));
        let circles = circles(&plane);
        // A card parallel to the film is drawn y (1 + m) tan τ off it at the height y, as the lens sees both at the same angle, and blurred by that over N (1 + m).
        let expected = tilt.to_radians().tan() / F_NUMBER;
        let slope = (circles[ROWS - 1] - circles[0]) / (ROWS - 1) as f64;
        let sharp = -circles[0] / slope - (ROWS as f64 - 1.0) / 2.0;
        println!("{lens}: {:.4} m, {slope:.4} px a row of {expected:.4}, sharp {sharp:.2} rows below the middle", found.unwrap());
        // Turned down: above, the plane of focus lies behind the card, and circles are negative.
        let allowed = if lens == "thin" { 0.05 } else { 0.25 };
        assert!((slope / expected - 1.0).abs() < allowed, "{lens}: {slope} px a row of {expected}");
        // The plane of focus meets the card within the zone of autofocus, whose depth of field is turned too, but for a quarter of the depth of focus 2 N c.
        let [_, _, _, height] = zones_named("one").unwrap()[0];
        let depth = 0.25 * 2.0 * F_NUMBER * 0.029 / tilt.to_radians().tan() / PIXEL;
        assert!(sharp.abs() < 0.5 * height * ROWS as f64 + depth, "{lens}: {sharp} rows of {height} {depth}");
        for at in plane.truth.float("position").unwrap().data.chunks_exact(3) {
            assert!((f64::from(at[2]) + distance).abs() < 1e-4, "{lens}: {at:?}");
        }
    }
}

#[test]
fn what_lies_in_the_plane_of_focus_of_a_tilted_lens_has_no_circle_of_confusion() {
    let (distance, tilt) = (1.5, 6.0f64.to_radians());
    for lens in ["thin", "double-gauss-50mm"] {
        let sky = || Description {
            environment: Some(diopter::scene::light::Environment::uniform(Vec3::splat(100.0))),
            ..Description::default()
        };
        // The plane through a point of the axis, and a direction in it that goes up.
        let (point, up) = match &shot(lens, 6.0, "1.5 m", "", sky()).camera.lens {
            // It meets the axis at the distance, and the hinge line f / sin τ below the lens (Merklinger 1992).
            Lens::Thin(_) => (DVec3::NEG_Z * distance, DVec3::new(0.0, 0.05 / tilt.sin(), -distance)),
            Lens::Compound(compound) => {
                let [point, normal] = compound.plane_of_focus().unwrap();
                (point * 1e-3, normal.cross(DVec3::X) * normal.cross(DVec3::X).y.signum())
            }
            _ => unreachable!("a lens with an aperture"),
        };
        let up = up / up.y;
        let corner = (point - up * 0.3 + DVec3::NEG_X * 4.0).as_vec3();
        let quad = Quad { corner, edges: [Vec3::X * 8.0, (up * 2.5).as_vec3()] };
        let card = Description {
            materials: vec![Material::new("card", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))],
            objects: vec![Object::new("card", Shape::Quad(quad), 0)],
            ..sky()
        };
        let (_, plane, _) = taken(shot(lens, 6.0, "1.5 m", "coc,position", card));
        let normal = up.cross(DVec3::X).normalize();
        for at in plane.truth.float("position").unwrap().data.chunks_exact(3) {
            let off = (Vec3::from_slice(at).as_dvec3() - point).dot(normal);
            assert!(off.abs() < 1e-4, "{lens}: {at:?}");
        }
        let circles = circles(&plane);
        let largest = circles.iter().fold(0.0f64, |a, c| a.max(c.abs()));
        println!("{lens}: {largest:.3} px");
        // A card across the axis has 1.2 px at the edges. Second moments are found by differences, to some hundredths of a pixel; the field of the double Gauss is
        // curved, and it has spherical aberration.
        assert!(largest < if lens == "thin" { 0.08 } else { 0.4 }, "{lens}: {largest} px, {circles:?}");
    }
}
