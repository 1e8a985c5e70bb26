//! Lens files of other programs, and what they must say.

use diopter_lens::glass::D_NM;
use diopter_lens::import::{self, Format};
use diopter_lens::paraxial::FirstOrder;
use diopter_lens::{Prescription, State, System};

/// Figures and small files of others; their sources are in its README.md.
const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data");

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
    let mut paths: Vec<_> = std::fs::read_dir(format!("{DATA}/lenses")).unwrap().map(|f| f.unwrap().path()).collect();
    paths.sort();
    for path in &paths {
        let name = path.display().to_string();
        let p = read(path);
        let f = first_order(&p, D_NM);
        println!("{:<60} {:9.4} {:9.4} {:?}", name.rsplit('/').next().unwrap(), f.efl, f.bfl, p.notes);
        let again = import::read(p.to_toml().as_bytes(), Format::Toml, "again.toml")
            .unwrap_or_else(|e| panic!("{name}: {e}\n{}", p.to_toml()));
        let g = first_order(&again, D_NM);
        assert!((f.efl - g.efl).abs() < 1e-9 * f.efl.abs() && (f.bfl - g.bfl).abs() < 1e-8, "{name}: {f:?} {g:?}");
    }
    // All formats but our own: 12 of pbrt, 3 of Zemax, 6 of CODE V, 10 of ISET.
    assert_eq!(paths.len(), 31);
}

#[test]
fn the_classic_lenses_have_their_focal_lengths() {
    // Paraxial focal length, back and front focal distance, traced independently (y-nu) from the indices of the files.
    for (file, efl, bfl, ffl) in [
        ("wide.22mm.dat", 22.024, 14.318, None),
        ("dgauss.50mm.dat", 50.3582, 36.1059, Some(-27.1224)),
        ("telephoto.250mm.dat", 249.5666, 105.0704, Some(-332.7025)),
        ("fisheye.10mm.dat", 9.9914, 23.1605, Some(7.9649)),
    ] {
        let f = first_order(&read(format!("{DATA}/lenses/{file}").as_ref()), D_NM);
        assert!((f.efl - efl).abs() < 6e-4 && (f.bfl - bfl).abs() < 6e-4, "{file}: {f:?}");
        assert!(ffl.is_none_or(|ffl| (f.ffl - ffl).abs() < 6e-4), "{file}: {f:?}");
    }
}

#[test]
fn wrong_files_are_refused_with_place_and_reason() {
    let toml = |surfaces: &str| format!("name = \"x\"\nf_number = 4\nsurfaces = [\n{surfaces}\n]\n");
    let lens =
        "{ radius = 50, gap = 5, glass = \"N-BK7\", semi_diameter = 10 },\n{ radius = -50, gap = 45, semi_diameter = 10 },";
    let many: String = (0..10_000).map(|_| "{ radius = 50, gap = 1, semi_diameter = 5 },\n").collect();
    let zemax = |surface: &str| {
        format!(
            "MODE SEQ\nUNIT MM\nENPD 5\nSURF 0\n TYPE STANDARD\n DISZ INFINITY\nSURF 1\n STOP\n{surface}\nSURF 2\n CURV -0.02\n DISZ 40\n DIAM 5\nSURF 3\n CURV 0\n DISZ 0\n"
        )
    };
    for (format, text, expected) in [
        (Format::Toml, String::new(), "missing field"),
        (Format::Toml, "name = \"x\"\nsurfaces = []".into(), "no surfaces"),
        (Format::Toml, toml(&lens.replace("N-BK7", "N-BK77")), "x.toml:4: surface 1: unknown glass \"N-BK77\"; did you mean"),
        (Format::Toml, toml(&lens.replace("radius = 50", "radius = 0")), "x.toml:4: surface 1: radius 0: expected a length"),
        (
            Format::Toml,
            toml(&lens.replace("radius = 50", "radius = 9")),
            "semi-diameter 10: the surface ends at a height of 9.0000 mm",
        ),
        (Format::Toml, toml(&lens.replace("gap = 5,", "gap = -5,")), "surface 1: gap -5: surfaces would cross"),
        (Format::Toml, toml(&lens.replace("gap = 5,", "gap = 0.2,")), "surface 1: it crosses surface 2"),
        (Format::Toml, toml(&lens.replace("gap = 45", "gap = -45")), "surface 2: gap -45 to the film"),
        (Format::Toml, toml(&lens.replace("gap = 5,", "gap = nan,")), "gap NaN"),
        (Format::Toml, toml(&lens.replace("gap = 5,", "gap = [1, 2],")), "surface 1: 2 gaps: expected one"),
        (Format::Toml, toml(&lens.replace("gap = 45", "gap = { infinity = 45, close = 50 }")), "no close_focus distance"),
        (
            Format::Toml,
            toml(&lens.replace("gap = 5,", "stop = true, gap = 5,").replace("gap = 45", "stop = true, gap = 45")),
            "surface 2: a second stop: surface 1",
        ),
        (Format::Toml, toml(&lens.replace("gap = 5,", "asphere = { x = 1 }, gap = 5,")), "power \"x\""),
        (Format::Toml, toml(&lens.replace("gap = 5,", "conik = 1, gap = 5,")), "unknown field `conik`"),
        (Format::Toml, toml(&lens.replace("N-BK7", "0.5/60")), "an index of 0.5"),
        (Format::Toml, toml(&many), "10000 surfaces: expected at most"),
        (Format::PbrtDat, "50 5 1.5 10\n-50 0 1 x".into(), "x.dat:2: surface 2: \"x\": expected a number"),
        (Format::PbrtDat, "50 5 1.5\n".into(), "3 numbers: expected radius, gap, index and diameter"),
        (Format::PbrtDat, "# nothing".into(), "no surfaces"),
        (Format::PbrtDat, "50 5 9.5 10\n".into(), "an index of 9.5"),
        (Format::Zemax, "MODE NSC".into(), "only sequential"),
        (Format::Zemax, "hello".into(), "expected SURF blocks"),
        (Format::Zemax, zemax(" TYPE PARAX_XY\n PARM 1 50\n DISZ 5"), "surface type PARAX_XY: an ideal lens"),
        (Format::Zemax, zemax(" TYPE ELLIPGR2\n DISZ 5"), "surface type ELLIPGR2: of gratings DGRATING is read"),
        (Format::Zemax, zemax(" TYPE STANDARD\n SPID 0.5 0\n DISZ 5"), "SPID 0.5 0: expected a width"),
        (
            Format::Zemax,
            zemax(" TYPE STANDARD\n CURV 0.02\n DISZ 5\n GLAS NOGLASS 0 0 1.5 40 0"),
            "what Zemax writes for any catalogue glass",
        ),
        (Format::Zemax, zemax(" TYPE STANDARD\n CURV 0.02\n DISZ 5\n GLAS NOGLASS 0 0"), "unknown glass \"NOGLASS\""),
        (Format::Zemax, zemax(" TYPE STANDARD\n CURV x\n DISZ 5"), "CURV x: expected a number"),
        (Format::CodeV, "EPD 5\nSO 0 1e11\nS 50 5 BK7_SCHOT\n".into(), "unknown glass"),
        (
            Format::CodeV,
            "RDM\nEPD 5\nS 50 5 NBK7_SCHOTT\nAAS; AR 1e-6\nS -50 45\nSTO\nSI 0 0".into(),
            "AR 0.000001: terms of an anamorphic",
        ),
        (
            Format::CodeV,
            "RDM\nEPD 5\nS 50 5 NBK7_SCHOTT\nXYZ 1\nS -50 45\nSTO\nSI 0 0".into(),
            "x.seq:4: surface 1: unknown command XYZ",
        ),
        (Format::CodeV, "RDM\nEPD 5\nS 50 5 NBK7_SCHOTT\nCUY UMZ -0.2\nS -50 45\nSTO\nSI 0 0".into(), "\"UMZ\" is not read"),
        (Format::CodeV, "RDM\nEPD 5\nS 50 5 NBK7_SCHOTT\nARO 3\nS -50 45\nSTO\nSI 0 0".into(), "an aperture that is turned"),
        (
            Format::CodeV,
            "RDM\nEPD 5\nS 50 5 NBK7_SCHOTT\nREX OBS 3\nS -50 45\nSTO\nSI 0 0".into(),
            "an obscuration with one half width",
        ),
        (
            Format::CodeV,
            "RDM\nEPD 5\nS 50 5 NBK7_SCHOTT\nS -50 45\nSTO\nSI 0 0\nS 30 1".into(),
            "a surface after the image surface",
        ),
        (
            Format::CodeV,
            "RDM\nEPD 5\nS 50 5 NBK7_SCHOTT\nK S7 -1\nS -50 45\n".into(),
            "K S7: the surfaces read so far are 1 to 1",
        ),
        (Format::CodeV, "ZOO 300".into(), "expected 1 to 64 positions"),
        (Format::Oslo, "LEN NEW \"x\" 1 2\nRD x".into(), "RD x: expected a number"),
        (Format::Iset, "{\"surfaces\": [{\"radius\": 1}]}".into(), "surface 1: no \"thickness\""),
        (Format::Iset, "[".repeat(100_000), "not JSON"),
        (Format::Iset, "{\"surfaces\": 5}".into(), "expected a list"),
    ] {
        let name = match format {
            Format::Toml => "x.toml",
            Format::PbrtDat => "x.dat",
            Format::Zemax => "x.zmx",
            Format::CodeV => "x.seq",
            Format::Oslo => "x.len",
            Format::Iset => "x.json",
        };
        match import::read(text.as_bytes(), format, name) {
            Ok(_) => panic!("accepted, expected \"{expected}\": {}", &text[..text.len().min(300)]),
            Err(e) => assert!(e.to_string().contains(expected), "found \"{e}\", expected \"{expected}\""),
        }
    }
    for bytes in [&[0u8, 1, 2, 3, 0, 0, 200, 7][..], &[0xFF; 64], b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"] {
        for format in [Format::Toml, Format::PbrtDat, Format::Zemax, Format::CodeV, Format::Oslo, Format::Iset] {
            assert!(import::read(bytes, format, "x").is_err());
        }
    }
}

#[test]
fn what_files_say_is_what_is_read() {
    use diopter_lens::surface::Profile;
    // A Zemax even asphere in inches, in UTF-16, with a model glass.
    let zmx = "MODE SEQ\r\nNAME Inch\r\nUNIT IN X W X CM MR CPMM\r\nENPD 0.2\r\nGCAT SCHOTT\r\nFTYP 0 0 1 1\r\nYFLN 0\r\nWAVM 1 0.5876 1\r\nPWAV 1\r\n\
        SURF 0\r\n  TYPE STANDARD\r\n  DISZ INFINITY\r\nSURF 1\r\n  STOP\r\n  TYPE EVENASPH\r\n  CURV 0.5\r\n  CONI -1.0\r\n  PARM 2 0.01\r\n  DISZ 0.1\r\n  GLAS ___BLANK 1 0 1.6 40\r\n  DIAM 0.2\r\n\
        SURF 2\r\n  TYPE STANDARD\r\n  CURV 0\r\n  DISZ 3\r\n  DIAM 0.2\r\nSURF 3\r\n  TYPE STANDARD\r\n  DISZ 0\r\n";
    let utf16: Vec<u8> = [0xFEFFu16].into_iter().chain(zmx.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    let p = import::read(&utf16, Format::Zemax, "a.zmx").unwrap();
    let Profile::Asphere(a) = &p.surfaces[0].profile else { panic!("{:?}", p.surfaces[0]) };
    assert!((a.c - 0.5 / 25.4).abs() < 1e-15 && a.k == -1.0 && (a.a[4] - 0.01 / 25.4f64.powi(3)).abs() < 1e-18);
    assert!((p.surfaces[0].gap.at(0.0, 0.0) - 2.54).abs() < 1e-12 && (p.surfaces[0].semi_diameter.unwrap() - 5.08).abs() < 1e-12);
    assert!((p.surfaces[0].glass.index(D_NM) - 1.6).abs() < 1e-9 && (p.surfaces[0].glass.abbe() - 40.0).abs() < 1e-6);
    // CODE V: radii, qualifiers, an asphere, a fictitious glass, a private glass, inches, a comment and a continued line.
    let seq = "RDM; LEN ! a comment; S 1 1\nTITLE 'A; lens'\nDIM I\nEPD 0.4\nWL 656.3 587.6 486.1\nREF 2\nYAN 0 5\nPRV\nPWL 656.3 587.6 486.1\n'MYGLAS' 1.50 1.505 1.512\nEND\n\
        SO 0 1e12\nS 2.0 0.2 &\n 517.642\n ASP\n K -0.5; A 0.01\nS -2.0 0.1 'MYGLAS'\nS 5 1.5\nSTO S1\nCIR S2 0.25\nSI 0 0\nGO\n";
    let p = import::read(seq.as_bytes(), Format::CodeV, "b.seq").unwrap();
    assert_eq!((p.name.as_str(), p.stop(), p.surfaces.len()), ("A; lens", 0, 3));
    let Profile::Asphere(a) = &p.surfaces[0].profile else { panic!("{:?}", p.surfaces[0]) };
    assert!((a.c - 1.0 / 50.8).abs() < 1e-15 && a.k == -0.5 && (a.a[4] - 0.01 / 25.4f64.powi(3)).abs() < 1e-18);
    assert!((p.surfaces[0].glass.index(D_NM) - 1.517).abs() < 1e-9 && (p.surfaces[0].glass.abbe() - 64.2).abs() < 1e-6);
    assert!((p.surfaces[1].glass.index(486.1) - 1.512).abs() < 1e-9);
    assert!((p.surfaces[1].semi_diameter.unwrap() - 6.35).abs() < 1e-12);
    // A mirror, a cylinder, a decentred element and varying gaps in our own form, and back.
    let text = "name = \"Odd\"\nzoom = [30, 60]\nclose_focus = 500\nsurfaces = [\n\
        { radius_x = 40, gap = [2, 3], glass = \"1.6/50/0.01\", semi_diameter = 10 },\n\
        { radius = 80, conic = -2, asphere = { 3 = 1e-5, 6 = -1e-9 }, gap = { infinity = [5, 6], close = 7 }, semi_diameter = 10, decenter = [0.1, 0] },\n\
        { stop = true, gap = 3, semi_diameter = 5 },\n{ mirror = true, radius = -300, gap = -60, semi_diameter = 20, obstruction = 2 },\n]\n\
        [iris]\nblades = 7\ncurvature = 0.5\n[[element]]\nsurfaces = [1, 2]\ndecenter = [0, 0.2, 0]\ntilt_deg = [1, 0, 0]\n";
    let p = import::read(text.as_bytes(), Format::Toml, "odd.toml").unwrap();
    let mut again = import::read(p.to_toml().as_bytes(), Format::Toml, "odd.toml").unwrap();
    let lines: Vec<usize> = p.surfaces.iter().map(|s| s.line).collect();
    again.surfaces.iter_mut().zip(lines).for_each(|(s, l)| s.line = l);
    assert_eq!(p, again);
    assert_eq!((p.surfaces[1].gap.at(0.0, 0.0), p.surfaces[1].gap.at(1.0, 0.5)), (5.0, 6.5));
}

#[test]
fn series_of_private_glasses_and_stops_without_a_size_are_read() {
    // Norland NOA61 in CODE V's form of Laurent's series; 1.5600 by the maker's data sheet.
    let seq = "RDM; LEN\nEPD 10\nWL 587.6\nPRV\nPWL 550.0\n'NOA61' LAU 2.36390625 0.0 0.025493134 -0.000580235 -0.349933e-5 0.445404e-7\nEND\n\
               SO 0 1e14\nS 50 4 'NOA61'\n STO\nS -50 40\nSI 0 0\nGO\n";
    let lens = import::read(seq.as_bytes(), Format::of("noa.seq").unwrap(), "noa.seq").unwrap();
    assert!((lens.surfaces[0].glass.index(587.5618) - 1.5600).abs() < 1e-3, "{}", lens.surfaces[0].glass.index(587.5618));
    assert!(lens.notes.iter().any(|n| n.contains("series")), "{:?}", lens.notes);
    let short = seq.replace(" 0.445404e-7", "");
    assert!(
        import::read(short.as_bytes(), Format::of("noa.seq").unwrap(), "noa.seq")
            .unwrap_err()
            .to_string()
            .contains("LAU and six coefficients")
    );

    // A stop that floats, without a size: the rims say how wide the beam is.
    let zmx = "MODE SEQ\nUNIT MM X W X CM MR CPMM\nFLOA\nWAVM 1 0.5876 1\nPWAV 1\nSURF 0\nTYPE STANDARD\nCURV 0\nDISZ INFINITY\n\
               SURF 1\nTYPE STANDARD\nCURV 0.02\nDISZ 4\nGLAS N-BK7 0 0 1.5 40\nDIAM 8 1 0 0 1 \"\"\nSURF 2\nTYPE STANDARD\nCURV -0.02\nDISZ 2\nDIAM 8 1 0 0 1 \"\"\n\
               SURF 3\nSTOP\nTYPE STANDARD\nCURV 0\nDISZ 40\nSURF 4\nTYPE STANDARD\nCURV 0\nDISZ 0\n";
    let lens = import::read(zmx.as_bytes(), Format::of("float.zmx").unwrap(), "float.zmx").unwrap();
    // The front lets 8 mm pass; by paraxial angles the beam is 7.78 mm high at the back of the glass and 7.45 mm at the stop, a real one a little less.
    let stop = lens.surfaces[2].semi_diameter.unwrap();
    assert!((7.35..7.5).contains(&stop), "{stop}");
    assert!(lens.notes.iter().any(|n| n.contains("no aperture is given")), "{:?}", lens.notes);
}
