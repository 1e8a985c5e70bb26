//! What lens files of Zemax and CODE V mean, on short files written for these tests.

use crate::packets::traced_alike;
use diopter_lens::batch::double::LANES;
use diopter_lens::coating::{Coating, DESIGN_NM, Recipe};
use diopter_lens::glass::D_NM;
use diopter_lens::import::{self, Format};
use diopter_lens::paraxial::FirstOrder;
use diopter_lens::prescription::ApertureKind;
use diopter_lens::ray::{Apertures, TraceDirection, TracedRay};
use diopter_lens::surface::Profile;
use diopter_lens::trace::at_plane;
use diopter_lens::{Prescription, State, System};
use glam::DVec3;

fn read(format: Format, text: &str) -> Prescription {
    import::read(text.as_bytes(), format, "test").unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn error(format: Format, text: &str) -> String {
    match import::read(text.as_bytes(), format, "test") {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(e) => e.to_string(),
    }
}

fn system(p: &Prescription) -> System {
    System::at(p, State::default())
}

fn efl(p: &Prescription) -> f64 {
    let s = system(p);
    FirstOrder::of(&s, &s.indices(D_NM)).efl
}

/// Where a ray that starts 10 mm before the first vertex meets the film, millimetres.
fn landing(s: &System, x: f64, y: f64, slope: f64) -> DVec3 {
    let ray = TracedRay { position: DVec3::new(x, y, -10.0), direction: DVec3::new(0.0, slope, 1.0).normalize() };
    at_plane(&s.trace(ray, &s.indices(D_NM), TraceDirection::ToFilm, Apertures::Ignore).unwrap(), s.film_z)
}

/// A Zemax file: head, object at infinity, these surfaces, a plane image.
fn zemax(surfaces: &[&str]) -> String {
    let mut text = String::from("MODE SEQ\nUNIT MM\nENPD 5\nWAVM 1 0.5876 1\nPWAV 1\nSURF 0\n TYPE STANDARD\n DISZ INFINITY\n");
    for (i, s) in surfaces.iter().enumerate() {
        text += &format!("SURF {}\n{}\n", i + 1, s.replace("; ", "\n"));
    }
    text + &format!("SURF {}\n TYPE STANDARD\n DISZ 0\n", surfaces.len() + 1)
}

#[test]
fn zemax_placeholders_are_no_glass_data() {
    let lens = |glass: &str| {
        zemax(&[
            &format!(" STOP; TYPE STANDARD; CURV 0.02; DISZ 4; GLAS {glass}; DIAM 6"),
            " TYPE STANDARD; CURV -0.02; DISZ 45; DIAM 6",
        ])
    };
    let index = |p: &Prescription| p.surfaces[0].glass.index(D_NM);
    // A name that nobody knows, with figures, then with the placeholder.
    let p = read(Format::Zemax, &lens("XYZ1 0 0 1.7 30 0"));
    assert!((index(&p) - 1.7).abs() < 1e-9 && p.notes.iter().any(|n| n.contains("nd 1.7, Vd 30")), "{:?}", p.notes);
    assert!(error(Format::Zemax, &lens("XYZ1 0 0 1.5 40 0")).contains("unknown glass \"XYZ1\""));
    // The model flag makes them figures.
    assert!((index(&read(Format::Zemax, &lens("___BLANK 1 0 1.5 40 0"))) - 1.5).abs() < 1e-9);
    // An alias takes the catalogue's figures beside the placeholder, and says so; other figures are another glass of that name.
    let p = read(Format::Zemax, &lens("LASF9 0 0 1.5 40 0 0 0"));
    assert!((index(&p) - 1.85025).abs() < 1e-5 && p.notes.iter().any(|n| n.contains("\"LASF9\" is taken for schott/N-LASF9")));
    assert!((index(&read(Format::Zemax, &lens("LASF9 0 0 1.6 50 0 0 0"))) - 1.6).abs() < 1e-9);
}

/// A singlet of BK7 whose head has these lines instead of its wavelengths and entrance pupil.
fn with_head(head: &str, object: &str, stop: &str) -> String {
    let lens = format!(
        "SURF 1\n STOP\n TYPE STANDARD\n CURV 0.01\n DISZ 5\n{stop} GLAS N-BK7 0 0 1.5 40\n DIAM 20 1\nSURF 2\n TYPE STANDARD\n CURV -0.01\n DISZ 187.4\n DIAM 20 1\n"
    );
    format!("MODE SEQ\nUNIT MM\n{head}\nSURF 0\n TYPE STANDARD\n DISZ {object}\n{lens}SURF 3\n TYPE STANDARD\n CURV 0\n DISZ 0\n")
}

#[test]
fn wavelengths_of_older_zemax_files_are_read() {
    let waves = |head: &str| {
        let p = read(Format::Zemax, &with_head(&format!("ENPD 10\n{head}"), "INFINITY", ""));
        let nm: Vec<f64> = p.usage.wavelengths_nm.iter().map(|nm| nm.round()).collect();
        (nm, p.usage.reference)
    };
    assert_eq!(waves("WAVL 1.064\nPWAV 1"), (vec![1064.0], 0));
    assert_eq!(waves("WAVL 0.4861 0.5876 0.6563\nWWGT 1 2 1\nPWAV 3"), (vec![486.0, 588.0, 656.0], 2));
    // The newer record stands, wherever it is.
    assert_eq!(waves("WAVM 1 0.55 1\nWAVL 0.4861 0.6563\nPWAV 1"), (vec![550.0], 0));
    assert!(error(Format::Zemax, &with_head("ENPD 10\nWAVL 0.5 x", "INFINITY", "")).contains("WAVL x: expected a number"));
}

#[test]
fn apertures_at_finite_conjugates_are_those_of_the_beam_that_is_used() {
    let pupil = |p: &Prescription| match p.usage.aperture {
        Some(ApertureKind::EntrancePupil(d)) => d,
        other => panic!("{other:?}"),
    };
    let zemax = |head: &str, object: &str| read(Format::Zemax, &with_head(head, object, ""));
    let code_v = |aperture: &str, object: &str| {
        let text = format!(
            "RDM; {aperture}; DIM M; WL 587.56; SO 0 {object}; S 100 5 NBK7_SCHOTT; STO; CIR 20; S -100 187.4; CIR 20; SI; GO"
        );
        read(Format::CodeV, &text)
    };
    // y-nu trace by hand from an object 200 mm before a lens of R 100 and -100 mm, 5 mm thick, n 1.5168: a slope of 1 becomes -1.06663.
    let expected = |tangent: f64| 2.0 * 200.0 * tangent / 1.06663;
    for p in [zemax("FNUM 8 1", "200"), code_v("FNO 8", "200")] {
        assert!((pupil(&p) - expected(1.0 / 16.0)).abs() < 0.005 && (pupil(&p) - 23.44).abs() < 0.01, "{}", pupil(&p));
        // The beam that the bench lets through is that of this pupil.
        assert!((p.used_f_number().unwrap() - efl(&p) / 23.44).abs() < 0.002, "{:?}", p.used_f_number());
    }
    let p = code_v("NA 0.0625", "200");
    assert!((pupil(&p) - expected(0.0625f64.asin().tan())).abs() < 0.005, "{}", pupil(&p));
    // In other units, too.
    let p = read(Format::Zemax, &with_head("FNUM 8 1", "200", "").replace("UNIT MM", "UNIT CM"));
    assert!((pupil(&p) - 234.38).abs() < 0.05, "{}", pupil(&p));
    // The infinite-conjugate f-number, and a distant object: as it is written.
    for p in [zemax("FNUM 8 0", "200"), zemax("FNUM 8 1", "INFINITY"), code_v("FNO 8", "1e13"), code_v("NA 0.0625", "1e13")] {
        assert_eq!(p.usage.aperture, Some(ApertureKind::FNumber(8.0)));
    }
    // Half a cone of 0.2 degrees, 200 mm before the stop in the first surface.
    let p = zemax("OBNA 0.2 1", "200");
    assert!((efl(&p) / p.used_f_number().unwrap() - 1.3963).abs() < 1e-4, "{:?}", p.usage.aperture);
    assert_eq!(zemax("OBNA 0.05 0", "200").usage.aperture, Some(ApertureKind::ObjectNa(0.05)));
    let refused = |head: &str| error(Format::Zemax, &with_head(head, "200", ""));
    assert!(refused("OBNA 95 1").contains("above 0 and below 90 degrees"));
    assert!(refused("FNUM -8 1").contains("expected a positive number"));
}

#[test]
fn plastics_of_a_zemax_file_have_its_own_figures() {
    let glass = |line: &str| {
        let p = read(Format::Zemax, &with_head("ENPD 10", "INFINITY", "").replace("N-BK7 0 0 1.5 40", line));
        (p.surfaces[0].glass.clone(), p.notes)
    };
    for (name, nd, vd) in
        [("PMMA", 1.491756, 57.44), ("POLYCARB", 1.58547, 29.91), ("POLYCARB", 1.6, 29.91), ("ACRYLIC", 1.491668, 55.31)]
    {
        let (found, notes) = glass(&format!("{name} 0 0 {nd} {vd} 0 0 0"));
        assert!((found.index(D_NM) - nd).abs() < 1e-3 && (found.abbe() - vd).abs() < 0.5, "{name}: {found:?} {notes:?}");
        let own = (found.index(D_NM) - nd).abs() < 1e-9;
        assert_eq!(own, notes.iter().any(|n| n.contains(&format!("the file's nd {nd}, Vd {vd} are used"))), "{name}: {notes:?}");
    }
    // A maker's glass keeps its own, beside the placeholder a plastic too.
    let (found, notes) = glass("N-BK7 0 0 1.6 50 0");
    assert!((found.index(D_NM) - 1.5168).abs() < 1e-5 && notes.iter().any(|n| n.contains("the catalogue's")), "{notes:?}");
    assert!((glass("PMMA 0 0 1.5 40 0").0.index(D_NM) - 1.491).abs() < 2e-3);
}

#[test]
fn coatings_of_a_zemax_file_are_read_by_their_names() {
    let lens = |first: &str, second: &str| {
        let text = with_head("ENPD 10", "INFINITY", &format!(" COAT {first}\n"));
        read(Format::Zemax, &text.replace(" CURV -0.01\n", &format!(" CURV -0.01\n COAT {second}\n")))
    };
    let p = lens("AR", "HEAR1");
    assert_eq!(p.surfaces[0].coating, Some(Coating::MagnesiumFluoride));
    assert_eq!(p.surfaces[1].coating, Some(Coating::Recipe(Recipe::ThreeLayer, DESIGN_NM)));
    for taken in ["coating AR is taken for a quarter wave of MgF2", "coating HEAR1 is taken for"] {
        assert_eq!(p.notes.iter().filter(|n| n.contains(taken)).count(), 1, "{:?}", p.notes);
    }
    let p = lens("EO_99", "EO_99");
    assert!(p.surfaces.iter().all(|s| s.coating.is_none()));
    assert!(p.notes.iter().any(|n| n.ends_with("are left out: EO_99")), "{:?}", p.notes);
    assert!(!lens("NULL", "").notes.iter().any(|n| n.contains("coating")));
}

#[test]
fn indices_beyond_what_is_known_are_noted() {
    let lens = |glass: &str| format!("RDM; EPD 5; WL 1550; SO 0 1e12; S 50 4 {glass}; STO; S -50 45; SI 0 0");
    let p = read(Format::CodeV, &lens("1.49:57.4"));
    assert!(p.notes.iter().any(|n| n.contains("1550 nm is extrapolated")), "{:?}", p.notes);
    let p = read(Format::CodeV, &lens("NBK7_SCHOTT"));
    assert!(!p.notes.iter().any(|n| n.contains("extrapolated")), "{:?}", p.notes);
}

#[test]
fn six_digits_are_a_glass_code_in_code_v() {
    let lens = |glass: &str| format!("RDM; EPD 5; SO 0 1e12; S 50 4 {glass}; STO; S -50 45; SI 0 0");
    for code in ["517642", "517.642"] {
        let glass = read(Format::CodeV, &lens(code)).surfaces[0].glass.clone();
        assert!((glass.index(D_NM) - 1.517).abs() < 1e-9 && (glass.abbe() - 64.2).abs() < 1e-6, "{code}: {glass:?}");
    }
    assert!(error(Format::CodeV, &lens("51764")).contains("51764"));
}

#[test]
fn files_with_the_line_ends_of_old_macintoshes_are_read() {
    for text in [with_head("ENPD 10\nWAVM 1 0.55 1", "INFINITY", ""), with_head("ENPD 10\r\nWAVM 1 0.55 1", "INFINITY", "")] {
        let p = read(Format::Zemax, &text);
        let old = read(Format::Zemax, &text.replace("\r\n", "\n").replace('\n', "\r"));
        assert_eq!((p.surfaces, p.usage), (old.surfaces, old.usage));
    }
}

#[test]
fn a_zemax_biconic_has_its_sag_and_traces_alike_in_packets() {
    let text = zemax(&[
        " STOP; TYPE BICONICX; CURV 0.02; CONI -1; PARM 1 100; PARM 2 0.5; DISZ 4; GLAS N-BK7 0 0; DIAM 6",
        " TYPE STANDARD; CURV -0.02; DISZ 60; DIAM 6",
    ]);
    let p = read(Format::Zemax, &text);
    assert_eq!(p.surfaces[0].profile, Profile::Biconic { c_x: 0.01, k_x: 0.5, c_y: 0.02, k_y: -1.0 });
    // The formula by hand: x = 3, y = 4; the conic of y is a parabola, which leaves the root to x.
    let expected = (0.09 + 0.32) / (1.0 + (1.0f64 - 1.5 * 1e-4 * 9.0).sqrt());
    assert!((p.surfaces[0].profile.sag(3.0, 4.0).unwrap() - expected).abs() < 1e-14);
    // Our own form keeps it.
    let again = import::read(p.to_toml().as_bytes(), Format::Toml, "again.toml").unwrap();
    assert_eq!(again.surfaces[0].profile, p.surfaces[0].profile);
    // Plain and packet trace.
    let s = system(&p);
    let ray = |i: usize| {
        let (x, y) = ((i % 4) as f64 * 2.0 - 3.0, (i / 4) as f64 * 2.0 - 3.0);
        TracedRay { position: DVec3::new(x, y, -10.0), direction: DVec3::new(0.02, -0.03, 1.0).normalize() }
    };
    assert_eq!(traced_alike(&s, &s.indices(D_NM), ray).len(), LANES);
}

#[test]
fn zemax_coordinate_breaks_turn_and_fold() {
    let front = " STOP; TYPE STANDARD; CURV 0.02; DISZ 4; GLAS N-BK7 0 0; DIAM 6";
    let straight = read(Format::Zemax, &zemax(&[front, " TYPE STANDARD; CURV 0; DISZ 90; DIAM 6"]));
    // A mirror at 45 degrees between lens and film: the same lens, unfolded.
    let folded = read(
        Format::Zemax,
        &zemax(&[
            front,
            " TYPE STANDARD; CURV 0; DISZ 40; DIAM 6",
            " TYPE COORDBRK; PARM 3 45; DISZ 0",
            " TYPE STANDARD; GLAS MIRROR 0 0 1.5 40; DISZ 0; DIAM 9",
            " TYPE COORDBRK; PARM 3 45; DISZ -50",
        ]),
    );
    assert!((efl(&folded) - efl(&straight)).abs() < 1e-9);
    assert!(system(&folded).is_rotational() && folded.notes.iter().any(|n| n.contains("1 plane mirror")), "{:?}", folded.notes);
    for y in [0.0, 2.0, 4.0] {
        let apart = landing(&system(&folded), 0.5, y, 0.05) - landing(&system(&straight), 0.5, y, 0.05);
        assert!(apart.truncate().length() < 1e-9, "{apart}");
    }
    // An element decentred by (0, 1) and set back by the second break: both its surfaces are.
    let decentred = read(
        Format::Zemax,
        &zemax(&[
            " STOP; TYPE STANDARD; DISZ 5; DIAM 4",
            " TYPE COORDBRK; PARM 2 1; DISZ 0",
            " TYPE STANDARD; CURV 0.02; DISZ 4; GLAS N-BK7 0 0; DIAM 8",
            " TYPE STANDARD; CURV 0; DISZ 0; DIAM 8",
            " TYPE COORDBRK; PARM 2 -1; DISZ 90",
        ]),
    );
    let places: Vec<[f64; 2]> = decentred.surfaces.iter().map(|s| s.decenter).collect();
    assert_eq!(places, [[0.0, 0.0], [0.0, 1.0], [0.0, 1.0]]);
    let total: f64 = decentred.surfaces.iter().map(|s| s.gap.at(0.0, 0.0)).sum();
    assert!((total - 99.0).abs() < 1e-9, "{total}");
    // A plane-parallel plate at 30 degrees shifts the axial ray by t sin a (1 - cos a / sqrt(n^2 - sin^2 a)); Born & Wolf 4.7.
    let plate = read(
        Format::Zemax,
        &zemax(&[
            " STOP; TYPE STANDARD; DISZ 20; DIAM 4",
            " TYPE COORDBRK; PARM 3 30; DISZ 0",
            " TYPE STANDARD; DISZ 6; GLAS N-BK7 0 0; DIAM 12",
            " TYPE STANDARD; DISZ 0; DIAM 12",
            " TYPE COORDBRK; PARM 3 -30; DISZ 20",
        ]),
    );
    let (n, a) = (plate.surfaces[1].glass.index(D_NM), 30f64.to_radians());
    let shift = 6.0 * a.sin() * (1.0 - a.cos() / (n * n - a.sin().powi(2)).sqrt());
    let s = system(&plate);
    let ray = TracedRay { position: DVec3::new(0.0, 0.0, -10.0), direction: DVec3::Z };
    let out = s.trace(ray, &s.indices(D_NM), TraceDirection::ToFilm, Apertures::Ignore).unwrap();
    assert!((out.direction - DVec3::Z).length() < 1e-12 && out.position.x.abs() < 1e-12, "{out:?}");
    // The axis of the last break went on inside the plate along its normal; the film's middle is where that left it.
    let offset = plate.misalignments.first().map_or(0.0, |m| m.decenter[1].abs()) + plate.surfaces[0].decenter[1].abs();
    assert!((offset - 6.0 * a.sin()).abs() < 1e-9, "{offset}");
    let axis = s.surfaces[0].to_lens(DVec3::ZERO, DVec3::Z).0.y;
    let ray = TracedRay { position: DVec3::new(0.0, axis, -10.0), direction: DVec3::Z };
    let landed = s.trace(ray, &s.indices(D_NM), TraceDirection::ToFilm, Apertures::Ignore).unwrap().position.y;
    assert!(((landed - axis).abs() - shift).abs() < 1e-9, "{landed} {axis} {shift}");
    // A curved mirror that folds the axis is set up about its base ray: R / 2, divided by the mean of 1 / cos and cos of 45 degrees (Coddington).
    let curved = read(
        Format::Zemax,
        &zemax(&[
            " STOP; TYPE STANDARD; DISZ 50; DIAM 4",
            " TYPE COORDBRK; PARM 3 45; DISZ 0",
            " TYPE STANDARD; CURV -0.005; GLAS MIRROR 0 0 1.5 40; DISZ 0; DIAM 9",
            " TYPE COORDBRK; PARM 3 45; DISZ -100",
        ]),
    );
    let cos = 45f64.to_radians().cos();
    assert!(
        curved.object_axis.is_some() && (efl(&curved) / (100.0 / (0.5 / cos + 0.5 * cos)) - 1.0).abs() < 1e-6,
        "{}",
        efl(&curved)
    );
}

#[test]
fn code_v_commands_after_the_image_leave_the_last_surface_alone() {
    let lens = |object: &str, glass: &str, after: &str| {
        format!("RDM; EPD 5; SO 0 {object}; S 50 4 {glass}; STO; S -50 45; SI 0 0.25; {after}; GO")
    };
    let plain = read(Format::CodeV, &lens("1e12", "1.5168:64.17", "THC 0"));
    let glass = &plain.surfaces[0].glass;
    assert!((glass.index(D_NM) - 1.5168).abs() < 1e-9 && (glass.abbe() - 64.17).abs() < 1e-6);
    assert_eq!((plain.usage.object_distance, plain.usage.defocus), (None, 0.25));
    for object in ["inf", "INFINITY", "1e13"] {
        assert_eq!(read(Format::CodeV, &lens(object, "1.5168:64.17", "THC 0")).usage.object_distance, None);
    }
    // Shape, size and stop commands after SI are the image's.
    let after = read(Format::CodeV, &lens("1e12", "1.5168:64.17", "CUY 0.01; CIR 3; K -1; THI 0.5"));
    assert_eq!(after.surfaces[1].profile, plain.surfaces[1].profile);
    assert_eq!((after.surfaces[1].semi_diameter, after.usage.defocus), (plain.surfaces[1].semi_diameter, 0.5));
    assert!(after.notes.iter().any(|n| n.contains("image surface is curved")), "{:?}", after.notes);
    // But a surface that is named is meant.
    let named = read(Format::CodeV, &lens("1e12", "1.5168:64.17", "K S2 -1"));
    assert_eq!(named.surfaces[1].profile, Profile::Conic { c: -0.02, k: -1.0 });
}

#[test]
fn code_v_anamorphic_aspheres_are_biconics() {
    let text = "EPD 5; SO 0 1e12; S 0.02 4 NBK7_SCHOTT; STO; AAS; CUX 0.01; KY -1; KX 0.5; AR 0.0; AP 0.3; S -0.02 45; SI 0 0";
    let p = read(Format::CodeV, text);
    assert_eq!(p.surfaces[0].profile, Profile::Biconic { c_x: 0.01, k_x: 0.5, c_y: 0.02, k_y: -1.0 });
    assert!(error(Format::CodeV, &text.replace("AAS; ", "")).contains("KX without AAS"));
}

#[test]
fn code_v_decenters_turn_return_reverse_and_bend() {
    let lens = |inside: &str| format!("RDM; EPD 5; SO 0 1e12; S 50 4 NBK7_SCHOTT; STO; S -50 20; {inside}; SI 0 0");
    let straight = read(Format::CodeV, &lens("S 0 30"));
    // BEN at 45 degrees is the straight lens.
    let bent = read(Format::CodeV, &lens("S 0 -30 REFL; ADE 45; BEN"));
    assert!((efl(&bent) - efl(&straight)).abs() < 1e-9 && bent.notes.iter().any(|n| n.contains("1 plane mirror")));
    for y in [0.0, 1.0, 2.0] {
        let apart = landing(&system(&bent), 0.3, y, 0.04) - landing(&system(&straight), 0.3, y, 0.04);
        assert!(apart.truncate().length() < 1e-9, "{apart}");
    }
    // DAR moves one surface, and the next is back in place. A positive ADE turns the axis towards +y (left hand).
    let returned = read(Format::CodeV, &lens("S 30 4 NBK7_SCHOTT; YDE 1; ADE 2; DAR; S 0 26"));
    let s = &returned.surfaces[2];
    assert!((s.decenter[1] - 1.0).abs() < 1e-12 && (s.tilt[0] + 2.0).abs() < 1e-9, "{s:?}");
    assert_eq!((returned.surfaces[3].decenter, returned.surfaces[3].tilt), ([0.0; 2], [0.0; 3]));
    let axis = system(&returned).surfaces[2].to_lens(DVec3::ZERO, DVec3::Z).1;
    assert!((axis.y - 2f64.to_radians().sin()).abs() < 1e-12, "{axis}");
    // A decenter without DAR moves what follows; REV with the same figures takes it back.
    let reversed = read(Format::CodeV, &lens("S 60 0 NBK7_SCHOTT; YDE 1; ADE 2; S 0 26; REV; YDE 1; ADE 2; S 0 0.5"));
    assert!((reversed.surfaces[3].decenter[1] - 1.0).abs() < 1e-12 && (reversed.surfaces[3].tilt[0] + 2.0).abs() < 1e-9);
    assert!(reversed.misalignments.is_empty(), "{:?}", reversed.misalignments);
}

#[test]
fn apertures_that_are_not_round_stop_light_as_the_file_says() {
    // Through a plane window in air and a lens; where rays parallel to the axis pass.
    let passes = |p: &Prescription, x: f64, y: f64| {
        let s = system(p);
        let ray = TracedRay { position: DVec3::new(x, y, -10.0), direction: DVec3::Z };
        s.trace(ray, &s.indices(D_NM), TraceDirection::ToFilm, Apertures::Clip).is_ok()
    };
    let p = read(
        Format::Zemax,
        &zemax(&[
            " TYPE STANDARD; DISZ 3; SQAP 4 2; OBDC 1 0; DIAM 1",
            " STOP; TYPE STANDARD; CURV 0.02; DISZ 4; GLAS N-BK7 0 0; SPID 0.4 4; ELOB 1 0.5; DIAM 9",
            " TYPE STANDARD; CURV -0.02; DISZ 45; OBSC 1.5 2; DIAM 9",
        ]),
    );
    assert!(p.notes.iter().all(|n| !n.contains("not round")), "{:?}", p.notes);
    assert!(passes(&p, 3.0, 1.9) && passes(&p, -2.9, 1.9), "inside the shifted rectangle");
    assert!(!passes(&p, -3.1, 1.0) && !passes(&p, 3.0, 2.1), "outside");
    assert!(!passes(&p, 3.0, 0.1) && passes(&p, 3.0, 0.3), "arm along x");
    assert!(!passes(&p, 0.8, 0.25) && passes(&p, 0.95, 0.4), "ellipse of 1 and 0.5 mm, and beside it");
    // Rays are a little nearer to the axis at the second surface: 0.97 times their height.
    assert!(!passes(&p, 1.3, 1.3), "ring of 1.5 to 2 mm");
    let text = "RDM; EPD 5; WL 587.6; SO 0 1e12; S 0 3; REX 4; REY 2; ADX 1; S 50 4 NBK7_SCHOTT; STO; CIR 9; \
                ELX OBS 1; ELY OBS 0.5; S -50 45; CIR 9; SI 0 0";
    let p = read(Format::CodeV, text);
    assert!(passes(&p, 3.0, 1.9) && !passes(&p, -3.1, 1.0) && !passes(&p, 0.8, 0.25) && passes(&p, 0.95, 0.4));
}

#[test]
fn q_type_aspheres_trace_alike_in_packets_and_come_back_from_toml() {
    let text = "name = \"q\"\nsurfaces = [\n\
        { radius = 30, conic = -0.5, gap = 5, glass = \"1.6\", semi_diameter = 9, stop = true, q_con = { radius = 10, terms = [0.05, -0.02, 0.01] } },\n\
        { radius = -80, gap = 30, semi_diameter = 9, q_bfs = { radius = 9.5, terms = [-0.08, 0.03, 0.002, -0.001] } },\n]\n";
    let p = read(Format::Toml, text);
    assert_eq!(
        read(Format::Toml, &p.to_toml()).surfaces.iter().map(|s| &s.profile).collect::<Vec<_>>(),
        p.surfaces.iter().map(|s| &s.profile).collect::<Vec<_>>()
    );
    let s = system(&p);
    assert!(s.is_rotational());
    let n = s.indices(D_NM);
    let ray = |i: usize| TracedRay {
        position: DVec3::new(-7.0 + i as f64, 0.3 * i as f64 - 2.0, -8.0),
        direction: DVec3::new(0.02 * i as f64 - 0.1, 0.05, 1.0).normalize(),
    };
    let met = traced_alike(&s, &n, ray).len();
    assert!(met > 10, "{met}");
    // A Q-con of one term is the asphere a₀ (r/10)⁴.
    let one = read(Format::Toml, &text.replace("terms = [0.05, -0.02, 0.01]", "terms = [0.05]"));
    let even =
        read(Format::Toml, &text.replace("q_con = { radius = 10, terms = [0.05, -0.02, 0.01] }", "asphere = { 4 = 5e-6 }"));
    let (a, b) = (landing(&system(&one), 1.0, 6.0, 0.05), landing(&system(&even), 1.0, 6.0, 0.05));
    assert!((a - b).length() < 1e-11, "{a} {b}");
    assert!(
        error(Format::Toml, &text.replace("conic = -0.5,", "asphere = { 4 = 1e-6 },")).contains("expected one kind of departure")
    );
}

#[test]
fn a_zemax_paraxial_surface_is_an_ideal_lens() {
    let p = read(Format::Zemax, &zemax(&[" STOP; TYPE PARAXIAL; PARM 1 40; PARM 2 1; DISZ 40; DIAM 5"]));
    assert!((efl(&p) - 40.0).abs() < 1e-12 && p.surfaces[0].ideal_focal_length == Some(40.0));
    let at = landing(&system(&p), 0.0, 3.0, 0.1);
    assert!((at.y - 4.0).abs() < 1e-12, "{at}");
    let e = error(Format::Zemax, &zemax(&[" STOP; TYPE PARAXIAL; DISZ 40; DIAM 5"]));
    assert!(e.contains("ideal_focal_length 0"), "{e}");
}

#[test]
fn zemax_gradients_bend_as_their_formulas_say() {
    // A rod of n² = 2.56 − 0.0256 r² in each of the forms, to the order that counts for the focal length.
    let rod = |kind: &str, parameters: &str| {
        let first = format!(" STOP; TYPE {kind}; {parameters}; DISZ 12; DIAM 2");
        read(Format::Zemax, &zemax(&[&first, " TYPE STANDARD; DISZ 8; DIAM 3"]))
    };
    let expected = 1.0 / (0.16 * 1.2f64.sin());
    for p in [
        rod("GRINSUR1", "PARM 1 0.1; PARM 2 1.6; PARM 3 -0.008"),
        rod("GRINSUR2", "PARM 1 0.1; PARM 2 2.56; PARM 3 -0.0256"),
        rod("GRINSUR3", "PARM 1 0.1; PARM 2 1.6; PARM 3 -0.008; PARM 4 -2e-5"),
    ] {
        assert!((efl(&p) / expected - 1.0).abs() < 1e-8, "{} {expected}", efl(&p));
    }
    let text = zemax(&[" STOP; TYPE GRINSUR5; DISZ 12; DIAM 2", " TYPE STANDARD; DISZ 8; DIAM 3"]);
    assert!(error(Format::Zemax, &text).contains("GRINSUR1, GRINSUR2 and GRINSUR3 are read"));
}

#[test]
fn solves_of_code_v_leave_the_figure_of_the_row() {
    let lens = |more: &str| {
        format!("RDM; DIM M; EPD 5; WL 587.6; YAN 0\nSO 0 1e12\nS 50 4 1.5168:64.17; STO\nS -50 45{more}\nSI 0 0\nGO\n")
    };
    let plain = read(Format::CodeV, &lens(""));
    for solve in ["THI HMY 0.0", "THI PIM", "CUY UMY -0.1", "RDY S2 APY"] {
        let solved = read(Format::CodeV, &lens(&format!("; {solve}")));
        assert_eq!(solved.surfaces[1].gap, plain.surfaces[1].gap, "{solve}");
        assert_eq!(solved.surfaces[1].profile, plain.surfaces[1].profile, "{solve}");
        assert!(
            solved.notes.iter().any(|n| n.contains(solve) && n.contains("the figure that the file has there stands")),
            "{:?}",
            solved.notes
        );
        assert!(plain.notes.iter().all(|n| !n.contains("solve")));
    }
    // What is no solve is still refused.
    let wrong = error(Format::CodeV, &lens("; THI ABC 0.0"));
    assert!(wrong.contains("ABC") && wrong.contains("expected one number, no solve"), "{wrong}");
}

#[test]
fn rims_of_other_programs_end_where_surfaces_cross() {
    // Two spheres of 50 mm, 1 mm apart, meet at √(50² − 49.5²) = 7.0534 mm; the files say 12.
    let height = (50.0f64.powi(2) - 49.5f64.powi(2)).sqrt();
    let zemax = zemax(&[
        " TYPE STANDARD; CURV 0.02; DISZ 1; GLAS ___BLANK 1 0 1.5; DIAM 12 1 0 0 1; CLAP 0 12 0; STOP",
        " TYPE STANDARD; CURV -0.02; DISZ 49; DIAM 12 1 0 0 1; CLAP 0 12 0",
    ]);
    let code_v =
        "RDM; DIM M; EPD 5; WL 587.6; YAN 0\nSO 0 1e12\nS 50 1 1.5168:64.17; STO; CIR 12\nS -50 49; CIR 12\nSI 0 0\nGO\n";
    for (format, text) in [(Format::Zemax, zemax.as_str()), (Format::CodeV, code_v)] {
        let p = read(format, text);
        for s in &p.surfaces {
            assert!((s.semi_diameter.unwrap() - height).abs() < 1e-6, "{format:?} {:?}", s.semi_diameter);
        }
        let note = "surfaces 1 and 2 cross at a height of 7.0534 mm: the semi-diameter of surface 1 and 2 ends there";
        assert!(p.notes.iter().any(|n| n.contains(note)), "{format:?} {:?}", p.notes);
        // Rims that leave glass between them stay as they are.
        let smaller = read(format, &text.replace(" 12", " 6.5"));
        assert!(smaller.surfaces.iter().all(|s| s.semi_diameter == Some(6.5)), "{format:?} {:?}", smaller.surfaces);
    }
}
