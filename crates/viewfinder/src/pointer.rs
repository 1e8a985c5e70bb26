//! The numbers under the pointer: what the pixel of the finder holds, from electrons to what is shown.

use crate::engine::at;
use crate::session::Live;
use diopter::develop::Developer;
use diopter::image::PictureSource;
use glam::DVec2;
use serde_json::{Value, json};

/// Middle grey of a developed picture, in linear light: what a place at the metered luminance is shown as.
const GREY: f64 = 0.18;

/// What is known of a place of the latest frame, 0 to 1 across and down.
pub fn numbers(live: &Live, place: [f64; 2]) -> Value {
    let (x, y) = at(&live.plane.mean, place);
    let electrons: serde_json::Map<String, Value> =
        live.plane.bands.iter().zip(live.plane.mean.pixel(x, y)).map(|(b, v)| (b.name.clone(), json!(v))).collect();
    let h = &live.raw.header;
    let ([width, height], samples) = (live.raw.size(), h.cfa.samples_per_pixel());
    // Of a pixel that has all channels, green.
    let (column, row) = (x.min(width - 1) * samples + samples / 2, y.min(height - 1));
    let dn = live.raw.mosaic.data[row * live.raw.mosaic.width + column];
    let film = film_point(live, place);
    json!({
        "kind": "probe", "at": place, "pixel": [x, y], "size": [live.plane.width(), live.plane.height()],
        "electrons": electrons, "dn": dn, "channel": h.cfa.filter_at(column, row).letter(),
        "black": h.black_level, "white": h.white_level, "saturated": f64::from(dn) >= h.white_level,
        "depth_m": depth_m(live, place), "ev100": ev100(live, [x, y]), "field_deg": field_deg(live, film),
        "film_mm": film.to_array(),
    })
}

/// Scene luminance at a pixel as EV at ISO 100, by the developed light: what the setting exposes for is shown as 18 % grey.
fn ev100(live: &Live, [x, y]: [usize; 2]) -> Option<f64> {
    let mut recipe = live.recipe.linear_light();
    recipe.exposure = Default::default();
    recipe.local = Default::default();
    recipe.resize = Default::default();
    recipe.output.space = diopter::develop::Space::Srgb;
    let developer = Developer::new(&live.raw, &recipe, None).ok()?;
    let [width, height] = developer.size();
    // Filters of patterns and light fields make smaller pictures.
    let column = x * width / live.plane.width().max(1);
    let row = (y * height / live.plane.height().max(1)).min(height.checked_sub(1)?);
    let line = developer.rows(row, 1);
    let rgb = line.get(3 * column..3 * column + 3)?;
    // Rec.709 luminance (ITU-R BT.709-6, item 3.2).
    let light = 0.2126 * f64::from(rgb[0]) + 0.7152 * f64::from(rgb[1]) + 0.0722 * f64::from(rgb[2]);
    (light > 0.0).then(|| live.setting_ev100 + (light / GREY).log2())
}

/// Distance of what the picture shows at a place (0 to 1 across and down) along the camera's axis, m; `None` where there is nothing.
pub fn depth_m(live: &Live, place: [f64; 2]) -> Option<f64> {
    let (x, y) = at(&live.plane.mean, place);
    let depth = f64::from(live.plane.truth.depth().pixel(x, y)[0]);
    depth.is_finite().then_some(depth)
}

/// The place of the film, mm to the right and up as the picture shows it, of one of the picture, 0 to 1 across and down.
pub fn film_point(live: &Live, [x, y]: [f64; 2]) -> DVec2 {
    DVec2::new((x - 0.5) * live.film_mm[0], (0.5 - y) * live.film_mm[1])
}

/// Angle of the chief ray of a place of the film (mm, to the right and up as the picture shows it) to the axis, degrees; `None` where the lens shows nothing there.
pub fn field_deg(live: &Live, film: DVec2) -> Option<f64> {
    // On the film the picture lies upside down.
    let ray = live.lens.chief_ray(-film).ok()?;
    Some(ray.direction.truncate().length().atan2(-ray.direction.z).to_degrees())
}

/// Field angle, degrees, of a place of the picture, 0 to 1 across and down.
pub fn field_at(live: &Live, place: [f64; 2]) -> Option<f64> {
    field_deg(live, film_point(live, place))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::for_finder;
    use diopter::expose::ProgressReporter;
    use diopter::shot::{Shot, ShotFile};
    use std::sync::atomic::AtomicBool;

    #[test]
    fn the_light_of_a_place_is_what_was_metered() {
        let mut file = ShotFile::default();
        file.scene.file = Some("color-chart".into());
        file.render.size = Some(diopter::quantity::Size { width: 60, height: 40 });
        file.render.spp = Some(8);
        let mut shot = Shot::prepare(&for_finder(&file), &mut |_| ()).unwrap();
        let go_on = AtomicBool::new(false);
        let watch = ProgressReporter { cancel: &go_on, progress: &|_| () };
        shot.meter(&watch, &mut |_| ()).unwrap();
        let plane = shot.expose(&watch).unwrap();
        let facts = shot.facts();
        let metered = facts.metered_ev100.unwrap();
        let live = Live {
            raw: shot.read_out(&plane).unwrap(),
            lens: shot.camera.lens.clone(),
            film_mm: [shot.camera.film.width_mm, shot.camera.film.height_mm],
            recipe: shot.recipe.clone(),
            setting_ev100: diopter::metering::ev100_of_setting(facts.t_number, facts.exposure_s, facts.iso),
            plane: plane.into(),
        };
        // In mode A the setting is what was metered.
        assert!((live.setting_ev100 - metered).abs() < 1e-6);
        // The mean of all places, as light, is the average that was metered: by the sensor's idea of luminance, and of few noisy pixels.
        let mut sum = 0.0;
        for row in 0..40 {
            for column in 0..60 {
                sum += ev100(&live, [column, row]).map_or(0.0, f64::exp2);
            }
        }
        let mean = (sum / 2400.0).log2();
        assert!((mean - metered).abs() < 0.15, "{mean} {metered}");
        let told = numbers(&live, [0.5, 0.5]);
        assert!(told["dn"].as_u64().unwrap() > 0 && told["depth_m"].as_f64().unwrap() > 0.0);
        assert_eq!(told["pixel"], json!([30, 20]));
        assert!(told["field_deg"].as_f64().unwrap() < 1.0);
        // The corner of 50 mm on 36 mm of width.
        let corner = field_at(&live, [0.0, 0.0]).unwrap();
        let expected = (0.5 * live.film_mm[0].hypot(live.film_mm[1]) / shot.camera.lens.focal_length().0).atan().to_degrees();
        assert!((corner - expected).abs() < 2.0, "{corner} {expected}");
        assert_eq!(numbers(&live, [1.0, 1.0])["pixel"], json!([59, 39]));
    }
}
