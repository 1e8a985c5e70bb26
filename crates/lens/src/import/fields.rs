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

/// Sets the fields of a lens whose surfaces all stand on its axis from places in x and y (degrees or mm): a round lens is the same in each direction. `cuts`: vignetting factors above and below
/// the chief ray, kept for fields in y. Gives what stands in the way, and sets nothing, where the places are no angles in y and cannot be made ones.
pub(super) fn set(p: &mut Prescription, kind: FieldKind, places: &[[f64; 2]], cuts: &[[f64; 2]]) -> Result<(), &'static str> {
    let cut = |i: usize| cuts.get(i).copied().unwrap_or([0.0; 2]);
    if kind == FieldKind::Angle && places.iter().all(|[x, _]| *x == 0.0) {
        p.usage.field_angles_deg = places.iter().map(|[_, y]| *y).collect();
        p.usage.vignetting = (0..places.len()).map(cut).collect();
        return Ok(());
    }
    let angle = angles_of(p, kind)?;
    let mut angles = vec![];
    for (i, [x, y]) in places.iter().enumerate() {
        // Light from above the axis comes down.
        let turned = kind == FieldKind::ObjectHeight;
        let deg = match kind {
            FieldKind::Angle => x.to_radians().tan().hypot(y.to_radians().tan()).atan().to_degrees(),
            _ => angle(x.hypot(*y)).ok_or("they lie beyond what the lens images")?,
        };
        let own = if *x == 0.0 { cut(i) } else { [0.0; 2] };
        angles.push((deg, if turned != (*y < 0.0) { [own[1], own[0]] } else { own }));
    }
    p.usage.field_angles_deg = angles.iter().map(|(deg, _)| (deg * 1e9).round() / 1e9).collect();
    p.usage.vignetting = angles.into_iter().map(|(_, cut)| cut).collect();
    let what = match kind {
        FieldKind::Angle => "fields beside the y axis are those of the same angle to the axis",
        FieldKind::ObjectHeight => {
            "fields given as heights of the object are those of the angles at which the entrance pupil sees them"
        }
        FieldKind::ParaxialHeight => "fields given as paraxial heights of the image are those of the angles that have them",
        FieldKind::RealHeight => "fields given as heights of the image are those of the angles whose chief rays have them",
    };
    p.notes.push(what.into());
    Ok(())
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
