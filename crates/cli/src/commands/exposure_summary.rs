//! What is said of an exposure: its setting, and what a camera shows after the shot.

use crate::watch::say;
use diopter::image::ExposureFacts;
use diopter::metering::ev100_of_facts;
use diopter::quantity::FNumber;

/// Time, aperture, speed.
pub fn setting(f: &ExposureFacts) -> String {
    let time = if f.exposure_s < 0.3 { format!("1/{:.0} s", 1.0 / f.exposure_s) } else { format!("{:.1} s", f.exposure_s) };
    let aperture = FNumber((f.f_number * 100.0).round() / 100.0);
    let at = if f.at_s > 0.0 { format!("   at {:.4} s", f.at_s) } else { String::new() };
    format!("{time}   {aperture}   ISO {:.0}{at}", f.speed().unwrap_or(100.0))
}

/// Says what a meter reads of light that was scaled by its mean luminance, where that is not the same.
pub fn say_ambient(ambient_ev: Option<f64>, facts: &ExposureFacts) {
    /// What is shown of an EV.
    const DIGIT: f64 = 0.1;
    if let (Some(mean), Some(read)) = (ambient_ev, facts.metered_ev100)
        && (mean - read).abs() >= DIGIT
    {
        say(&format!(
            "note: the mean luminance is that of EV {mean:.1}, as --ambient-ev asks; the meter ({}) reads EV {read:.1}",
            facts.metering
        ));
    }
}

/// What a camera shows after the shot. `width` and `height`: of the picture, pixels; `seconds`: how long it took.
pub fn display(f: &ExposureFacts, width: usize, height: usize, seconds: f64) -> String {
    let focus = f.focus_distance_m.map_or("∞".to_owned(), |d| format!("{d:.2} m"));
    let meter = match f.metered_ev100 {
        None => "no light metered".to_owned(),
        Some(ev) => {
            let off = ev - ev100_of_facts(f);
            let without = if f.flash { " without the flash" } else { "" };
            format!("scene EV {ev:.1} ({}), exposure {} EV{without}", f.metering, signed(off))
        }
    };
    let mut extras = String::new();
    if f.compensation_ev != 0.0 {
        extras.push_str(&format!("   compensation {:+.1} EV", f.compensation_ev));
    }
    if f.nd_stops > 0.0 {
        extras.push_str(&format!("   ND {:.1} stops", f.nd_stops));
    }
    if !f.polarizer.is_empty() {
        extras.push_str(&format!("   polariser {}", f.polarizer));
    }
    if !f.photodiodes.is_empty() {
        extras.push_str(&format!("   {} photodiodes", f.photodiodes));
    }
    if f.flash {
        extras.push_str("   flash");
    }
    if let Some(s) = f.shutter.as_ref().filter(|s| s.kind != "global") {
        extras.push_str(&format!("   {} shutter, {:.2} ms in all", s.kind, s.total_s * 1e3));
    }
    if let Some(removed) = f.fireflies_removed {
        extras.push_str(&format!("   fireflies: {:.2} % of the light taken away", 100.0 * removed));
    }
    if f.denoised {
        extras.push_str(&format!("   denoised ({})", f.denoiser));
    }
    let scaled = if f.light_scale == 1.0 { String::new() } else { format!("   light × {:.3e}", f.light_scale) };
    let setting = setting(f);
    format!(
        "{}   {}   {}\nmode {}   {setting}   {:.0} mm ({:.0} mm equiv.)   focus {focus}{extras}\n{meter}{scaled}   {width}×{height}, {} samples a pixel, {seconds:.1} s",
        f.body, f.lens, f.scene, f.mode, f.focal_length_mm, f.focal_length_35mm_mm, f.samples
    )
}

/// With a sign, and no "-0.0".
fn signed(ev: f64) -> String {
    let ev = (ev * 10.0).round() / 10.0;
    format!("{:+.1}", if ev == 0.0 { 0.0 } else { ev })
}
