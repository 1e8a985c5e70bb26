//! Gaussian splats as other programs read them: points with KHR_gaussian_splatting (as ratified in 2026), kernel "ellipse", harmonics as floats.

use super::Writer;
use crate::shape::{ColorCurve, Splats};
use serde_json::{Value, json};

const EXTENSION: &str = "KHR_gaussian_splatting";

impl Writer {
    /// A set as a primitive.
    pub(super) fn splats(&mut self, set: &Splats) -> Value {
        self.extensions.insert(EXTENSION);
        let all: Vec<_> = (0..set.len()).map(|i| set.splat(i)).collect();
        let position = self.vectors(&all.iter().map(|s| s.center.to_array()).collect::<Vec<_>>());
        let bounds = crate::bvh::Bounds::around(all.iter().map(|s| s.center));
        self.accessors[position]["min"] = json!(bounds.min.to_array());
        self.accessors[position]["max"] = json!(bounds.max.to_array());
        let mut attributes = json!({ "POSITION": position });
        let mut put = |name: &str, accessor: usize| attributes[format!("{EXTENSION}:{name}")] = json!(accessor);
        put("ROTATION", self.vectors(&all.iter().map(|s| s.rotation.to_array()).collect::<Vec<_>>()));
        put("SCALE", self.vectors(&all.iter().map(|s| s.scale.to_array()).collect::<Vec<_>>()));
        put("OPACITY", self.numbers(&all.iter().map(|s| s.opacity).collect::<Vec<_>>(), 1));
        let mut number = 0;
        for degree in 0..=set.degree() {
            for n in 0..2 * degree + 1 {
                let coefficients: Vec<[f32; 3]> = (0..set.len()).map(|i| set.harmonic(i, number)).collect();
                put(&format!("SH_DEGREE_{degree}_COEF_{n}"), self.vectors(&coefficients));
                number += 1;
            }
        }
        let color_space = match set.curve() {
            ColorCurve::Srgb => "srgb_rec709_display",
            ColorCurve::Linear => "lin_rec709_display",
        };
        let said = json!({ "kernel": "ellipse", "colorSpace": color_space, "sortingMethod": "cameraDistance", "projection": "perspective" });
        json!({ "attributes": attributes, "mode": 0, "extensions": { EXTENSION: said } })
    }
}
