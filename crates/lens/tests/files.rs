//! Lens files of other programs, and what they must say.

use diopter_lens::glass::D_NM;
use diopter_lens::import::{self, Format};
use diopter_lens::paraxial::FirstOrder;
use diopter_lens::{Prescription, State, System};
use std::path::PathBuf;

/// The folder of reference data beside the project, if it is there.
pub fn data() -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    if !folder.is_dir() {
        eprintln!("skipped: the reference data (shared/data) is not there");
        return None;
    }
    Some(folder)
}

fn read(path: &std::path::Path) -> Prescription {
    let name = path.display().to_string();
    let format = Format::of(&name).unwrap();
    import::read(&std::fs::read(path).unwrap(), format, &name).unwrap_or_else(|e| panic!("{e}"))
}

fn first_order(p: &Prescription, nm: f64) -> FirstOrder {
    let system = System::at(p, State::default());
    FirstOrder::of(&system, &system.indices(nm))
}

#[test]
fn every_lens_file_is_read_and_survives_our_own_form() {
    let Some(data) = data() else { return };
    let mut count = 0;
    for folder in std::fs::read_dir(data.join("lenses")).unwrap() {
        let folder = folder.unwrap().path();
        if !folder.is_dir() || folder.ends_with("golden") || folder.ends_with("lentil") {
            continue;
        }
        for file in std::fs::read_dir(folder).unwrap() {
            let path = file.unwrap().path();
            let name = path.display().to_string();
            if name.contains("deeplens") || name.ends_with("Cooke_triplet.json") || name.contains("microlens") {
                continue;
            }
            if Format::of(&name).is_none() {
                continue;
            }
            let p = read(&path);
            let f = first_order(&p, D_NM);
            println!("{:<60} {:9.4} {:9.4} {:?}", name.rsplit('/').next().unwrap(), f.efl, f.bfl, p.notes);
            let again = import::read(p.to_toml().as_bytes(), Format::Toml, "again.toml").unwrap_or_else(|e| panic!("{name}: {e}\n{}", p.to_toml()));
            let g = first_order(&again, D_NM);
            assert!((f.efl - g.efl).abs() < 1e-9 * f.efl.abs() && (f.bfl - g.bfl).abs() < 1e-8, "{name}: {f:?} {g:?}");
            count += 1;
        }
    }
    assert!(count >= 30, "{count}");
}

#[test]
fn the_classic_lenses_have_their_focal_lengths() {
    let Some(data) = data() else { return };
    // TRUTHS 1(e): paraxial focal length, back and front focal distance.
    for (file, efl, bfl, ffl) in [
        ("kolb_wide.22mm/wide.22mm.dat", 22.024, 14.318, None),
        ("kolb_dgauss.50mm/dgauss.50mm.dat", 50.3582, 36.1059, Some(-27.1224)),
        ("kolb_telephoto.250mm/telephoto.250mm.dat", 249.5666, 105.0704, Some(-332.7025)),
        ("kolb_fisheye.10mm/fisheye.10mm.dat", 9.9914, 23.1605, Some(7.9649)),
    ] {
        let f = first_order(&read(&data.join("lenses").join(file)), D_NM);
        assert!((f.efl - efl).abs() < 6e-4 && (f.bfl - bfl).abs() < 6e-4, "{file}: {f:?}");
        assert!(ffl.is_none_or(|ffl| (f.ffl - ffl).abs() < 6e-4), "{file}: {f:?}");
    }
}
