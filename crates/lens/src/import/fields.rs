//! Fields that a file gives as heights, or beside the y axis, as angles from the axis.

use crate::analysis::Bench;
use crate::paraxial::{FirstOrder, Trace};
use crate::prescription::Prescription;
use crate::system::{State, System};

/// What a field is given as.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum FieldKind {
    /// Degrees from the axis.
    Angle,
    /// Height of the object, mm; above the axis where it is positive.
    ObjectHeight,
    /// Height of the image by first order, mm.
    ParaxialHeight,
    /// Height of the image by the chief ray, mm.
    RealHeight,
}

/// Fields as a file gives them.
pub(super) struct Fields {
    pub kind: FieldKind,
    /// In x and y, degrees or mm.
    pub places: Vec<[f64; 2]>,
    /// Vignetting factors above and below the chief ray; missing ones are 0.
    pub cuts: Vec<[f64; 2]>,
}

impl Fields {
    /// Fields of figures in x and in y, as many as the longer list has, and of vignetting factors. `unit`: mm of a unit of heights.
    pub fn new(kind: FieldKind, [x, y]: [&[f64]; 2], cuts: Vec<[f64; 2]>, unit: f64) -> Fields {
        let figure = |of: &[f64], i: usize| of.get(i).copied().unwrap_or(0.0);
        let unit = if kind == FieldKind::Angle { 1.0 } else { unit };
        let places = (0..x.len().max(y.len())).map(|i| [x, y].map(|of| figure(of, i) * unit)).collect();
        Fields { kind, places, cuts }
    }

    fn cut(&self, i: usize) -> [f64; 2] {
        self.cuts.get(i).copied().unwrap_or([0.0; 2])
    }

    /// Sets angles in y, which must be known before surfaces are placed; whether these are all. Where surfaces stand beside the axis (`is_moved`) those in x are left out, with a note.
    pub fn set_angles(&self, p: &mut Prescription, is_moved: bool) -> bool {
        let is_beside = self.places.iter().any(|[x, _]| *x != 0.0);
        if self.kind != FieldKind::Angle || (is_beside && !is_moved) {
            return false;
        }
        if is_beside {
            p.notes.push("fields in x are not taken over, only those in y".into());
        }
        p.usage.field_angles_deg = self.places.iter().map(|[_, y]| *y).collect();
        p.usage.vignetting = (0..self.places.len()).map(|i| self.cut(i)).collect();
        true
    }

    /// Sets the angles of other fields of a lens whose surfaces have their places, with a note. A round lens is the same in each direction; of another one nothing is set.
    pub fn set_others(&self, p: &mut Prescription) {
        let note = match self.angles(p) {
            Ok(angles) => {
                (p.usage.field_angles_deg, p.usage.vignetting) = angles.into_iter().unzip();
                match self.kind {
                    FieldKind::Angle => "fields beside the y axis are those of the same angle to the axis".into(),
                    FieldKind::ObjectHeight => {
                        "fields given as heights of the object are those of the angles at which the entrance pupil sees them"
                            .into()
                    }
                    FieldKind::ParaxialHeight => {
                        "fields given as paraxial heights of the image are those of the angles that have them".into()
                    }
                    FieldKind::RealHeight => {
                        "fields given as heights of the image are those of the angles whose chief rays have them".into()
                    }
                }
            }
            Err(why) => format!("fields that are not angles in y are not taken over: {why}"),
        };
        p.notes.push(note);
    }

    /// Angles, degrees, and vignetting factors, which are known of fields in y alone. Fails with what stands in the way.
    fn angles(&self, p: &Prescription) -> Result<Vec<(f64, [f64; 2])>, &'static str> {
        let angle = angles_of(p, self.kind)?;
        let one = |(i, [x, y]): (usize, &[f64; 2])| {
            let deg = match self.kind {
                FieldKind::Angle => x.to_radians().tan().hypot(y.to_radians().tan()).atan().to_degrees(),
                _ => angle(x.hypot(*y)).ok_or("they lie beyond what the lens images")?,
            };
            let [above, below] = if *x == 0.0 { self.cut(i) } else { [0.0; 2] };
            // Light from above the axis comes down.
            let is_turned = (self.kind == FieldKind::ObjectHeight) != (*y < 0.0);
            Ok(((deg * 1e9).round() / 1e9, if is_turned { [below, above] } else { [above, below] }))
        };
        self.places.iter().enumerate().map(one).collect()
    }
}

/// The angle (degrees) of a height.
fn angles_of(p: &Prescription, kind: FieldKind) -> Result<impl Fn(f64) -> Option<f64> + use<>, &'static str> {
    if p.object_axis.is_some()
        || !p.misalignments.is_empty()
        || p.surfaces.iter().any(|s| !s.looks_round() || s.decenter != [0.0; 2] || s.tilt != [0.0; 3])
    {
        return Err("the lens is not round");
    }
    let mut whole = p.clone();
    if !whole.surfaces.iter().any(|s| s.stop) {
        let stop = whole.infer_stop();
        whole.surfaces.get_mut(stop).ok_or("the lens has no surfaces")?.stop = true;
    }
    let nm = whole.inference_nm();
    let system = System::at(&whole, State::default());
    let n = system.indices(nm);
    let first = FirstOrder::of(&system, &n);
    let to_object = p.usage.object_distance.map(|d| d + first.entrance_pupil_z);
    let magnification = p.usage.object_distance.map(|d| 1.0 / (first.image_index * Trace::new(&system, &n, d, 1.0).last().1));
    if kind == FieldKind::ObjectHeight && to_object.is_none_or(|d| !(d > 0.0)) {
        return Err("the object is at infinity");
    }
    let object_distance = p.usage.object_distance;
    Ok(move |height: f64| {
        let seen = |object: f64| Some((object / to_object?).atan().to_degrees());
        let deg: Option<f64> = match (kind, magnification) {
            _ if height == 0.0 => Some(0.0),
            (FieldKind::Angle, _) => None,
            (FieldKind::ObjectHeight, _) => seen(height),
            (FieldKind::ParaxialHeight, Some(m)) => seen((height / m).abs()),
            (FieldKind::ParaxialHeight, None) => Some((height / first.efl).abs().atan().to_degrees()),
            (FieldKind::RealHeight, _) => {
                let bench = Bench { system: &system, object_distance };
                // Beyond what the lens images the last angle that it does stands for all heights.
                let [deg, within] = [height, 0.99 * height].map(|h| bench.field_of_height(h));
                Some(deg).filter(|deg| *deg > within)
            }
        };
        deg.filter(|deg| deg.is_finite())
    })
}
