//! Contact sheets and lessons as a user meets them.

use crate::common::Folder;
use serde_json::Value;

/// Width and height of a PNG.
fn size_of(png: &[u8]) -> [u32; 2] {
    assert!(png.starts_with(b"\x89PNG"));
    [16, 20].map(|at| u32::from_be_bytes(png[at..at + 4].try_into().unwrap()))
}

/// Pictures in a PDF.
fn pictures(pdf: &[u8]) -> usize {
    pdf.windows(15).filter(|w| *w == b"/Subtype /Image").count()
}

/// What is denoised may depend on a library that is found: bytes are compared without.
const SHOT: [&str; 12] =
    ["shoot", "cornell", "--size", "48x32", "--spp", "2", "--shutter", "1/30", "--aperture", "f/5.6", "--denoise", "off"];

fn sheet(f: &Folder, rest: &[&str]) -> Value {
    serde_json::from_slice(&f.ok(&[&SHOT[..], rest, &["--json"]].concat()).stdout).unwrap()
}

#[test]
fn iso_speeds_share_one_exposure() {
    let f = Folder::new("sheet-iso");
    let vary = ["--vary", "iso=100,400,1600", "--sheet", "iso.png", "--sheet", "iso.html", "--sheet", "iso.pdf"];
    let told = sheet(&f, &vary);
    assert_eq!((told["exposures"].as_u64(), told["columns"].as_u64()), (Some(1), Some(3)), "{told}");
    let cells = told["cells"].as_array().unwrap();
    let speeds: Vec<f64> = cells.iter().map(|c| c["facts"]["iso"].as_f64().unwrap()).collect();
    assert_eq!(speeds, [100.0, 400.0, 1600.0]);
    assert_eq!(cells[1]["label"], "iso 400");
    // 12 px between and around pictures, 40 px of text under each row.
    let png = f.read("iso.png");
    assert_eq!(size_of(&png), [12 + 3 * 60, 12 + 32 + 40 + 12]);
    let html = String::from_utf8(f.read("iso.html")).unwrap();
    assert_eq!(html.matches("data:image/png;base64,").count(), 3);
    assert!(html.contains("iso 1600") && !html.contains("src=\"iso"));
    let pdf = f.read("iso.pdf");
    assert!(pdf.starts_with(b"%PDF-") && pictures(&pdf) == 3, "{}", pictures(&pdf));
    // The same bytes again, with any number of threads.
    sheet(&f, &[&vary[..], &["--threads", "1"]].concat());
    assert!(png == f.read("iso.png") && html.as_bytes() == f.read("iso.html") && pdf == f.read("iso.pdf"));
}

#[test]
fn developments_share_one_raw_image_and_two_axes_make_rows() {
    let f = Folder::new("sheet-axes");
    let told = sheet(&f, &["--vary", "tone=linear,reinhard,agx", "--vary", "aperture=f/4,f/8", "--sheet", "two.png"]);
    assert_eq!((told["exposures"].as_u64(), told["cells"].as_array().unwrap().len()), (Some(2), 6), "{told}");
    assert_eq!(told["cells"][5]["label"], "tone agx, aperture f/8");
    assert_eq!(size_of(&f.read("two.png")), [12 + 3 * 60, 12 + 2 * (32 + 40 + 12)]);
    // Settings that change together; a title, crops and histograms.
    let told = sheet(
        &f,
        &[
            "--vary",
            "aperture:shutter=f/4:1/60,f/8:1/15",
            "--sheet",
            "pairs.png",
            "--sheet-title",
            "Pairs",
            "--sheet-histogram",
            "--sheet-crop",
            "0.5,0.5",
            "--sheet-cell",
            "24",
        ],
    );
    let ev: Vec<f64> = told["cells"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| (c["facts"]["f_number"].as_f64().unwrap().powi(2) / c["facts"]["exposure_s"].as_f64().unwrap()).log2())
        .collect();
    assert!((ev[0] - ev[1]).abs() < 1e-9, "{ev:?}");
    // A picture of 24 × 16, a gap of 6, a crop of 16 rows and a histogram of 64 rows; 34 px of title.
    assert_eq!(size_of(&f.read("pairs.png")), [12 + 2 * 36, 34 + 12 + 16 + 6 + 16 + 64 + 40 + 12]);
}

#[test]
fn sheet_files_are_taken() {
    let f = Folder::new("sheet-file");
    let text = "title = \"Gamma\"\ntext = [\"one\", \"two\"]\n[[vary]]\nname = \"gamma\"\nvalues = [\"1.8\", \"2.4\"]\n\
                labels = [\"bright\", \"dark\"]\n[shot.scene]\nfile = \"cornell\"\n[shot.exposure]\nshutter = \"1/30\"\n";
    std::fs::write(f.path("gamma.toml"), text).unwrap();
    let args = ["sheet", "gamma.toml", "--size", "30x20", "--spp", "1", "-o", "gamma.jpg", "-o", "gamma.png", "--json"];
    let told: Value = serde_json::from_slice(&f.ok(&args).stdout).unwrap();
    assert_eq!((told["exposures"].as_u64(), &told["cells"][1]["label"]), (Some(1), &Value::from("dark")), "{told}");
    assert!(f.read("gamma.jpg").starts_with(&[0xff, 0xd8]));
    // A title and two lines above.
    assert_eq!(size_of(&f.read("gamma.png")), [12 + 2 * 42, 34 + 40 + 12 + 20 + 40 + 12]);
    std::fs::write(f.path("wrong.toml"), text.replace("labels", "label")).unwrap();
    let (code, message) = f.fails(&["sheet", "wrong.toml", "-o", "x.png"]);
    assert!(code == 2 && message.contains("wrong.toml") && message.contains("label"), "{message}");
}

#[test]
fn tables_of_calc_stand_under_the_pictures() {
    let f = Folder::new("sheet-tables");
    let vary = ["--vary", "iso=100,400", "--sheet", "a.png", "--sheet", "a.html", "--sheet", "a.pdf"];
    sheet(&f, &vary);
    let plain = size_of(&f.read("a.png"));
    let told =
        sheet(&f, &[&vary[..], &["--sheet-table", "calc stop --focal-length 50mm", "--sheet-table", "calc formats"]].concat());
    let stop = String::from_utf8(f.ok(&["calc", "stop", "--focal-length", "50mm"]).stdout).unwrap();
    assert_eq!(told["tables"][0].as_str(), Some(stop.trim_end()));
    let with = size_of(&f.read("a.png"));
    assert!(with[0] == plain[0] && with[1] > plain[1] + 80, "{plain:?} {with:?}");
    let html = String::from_utf8(f.read("a.html")).unwrap();
    assert!(html.contains("<p>calc stop --focal-length 50mm</p>") && html.matches("<pre>").count() == 2);
    // Of a sheet file, with a caption; what would write a file is refused before anything is exposed.
    let file = |table: &str| {
        format!("vary = [{{ name = \"iso\", values = [100, 400] }}]\ntable = [{table}]\nshot.scene.file = \"cornell\"\n")
    };
    std::fs::write(f.0.join("ok.toml"), file("{ command = \"calc formats\", caption = \"Formats & sizes\" }")).unwrap();
    f.ok(&["sheet", "ok.toml", "--size", "30x20", "--spp", "1", "-o", "ok.html"]);
    assert!(String::from_utf8(f.read("ok.html")).unwrap().contains("<p>Formats &amp; sizes</p>"));
    for wrong in ["calc formats -o x.png", "calc formats --output=x.png", "shoot cornell", ""] {
        std::fs::write(f.0.join("wrong.toml"), file(&format!("{{ command = \"{wrong}\" }}"))).unwrap();
        let (code, message) = f.fails(&["sheet", "wrong.toml", "-o", "x.html"]);
        assert!(code == 2 && message.contains("without -o"), "{wrong}: {code} {message}");
    }
    let (_, message) = f.fails(&[&SHOT[..], &vary, &["--sheet-table", "calc nothing"]].concat());
    assert!(message.contains("calc nothing"), "{message}");
}

#[test]
fn what_makes_no_sheet_is_said() {
    let f = Folder::new("sheet-wrong");
    let cases: [(&[&str], &str); 8] = [
        (&["--vary", "isso=100,200", "--sheet", "a.png"], "did you mean \"iso\""),
        (&["--vary", "iso=fast,200", "--sheet", "a.png"], "ISO 400"),
        (&["--vary", "iso", "--sheet", "a.png"], "iso=100,200,400"),
        (&["--vary", "iso=100,200"], "--sheet"),
        (&["--sheet", "a.png"], "--vary"),
        (&["--vary", "iso=100,200", "--sheet", "a.gif"], ".png, .jpg, .html or .pdf"),
        (&["--vary", "iso=100,200", "--sheet", "a.png", "-o", "b.png"], "cannot be used with"),
        (&["--vary", "iso=100,200", "--vary", "iso=400", "--sheet", "a.png"], "twice"),
    ];
    for (rest, said) in cases {
        let (code, message) = f.fails(&[&SHOT[..], rest].concat());
        assert!(code == 2 && message.contains(said), "{rest:?}: {code} {message}");
    }
    // The second picture cannot be taken: said before the first is, with its place.
    let (code, message) = f.fails(&[&SHOT[..], &["--vary", "lens=thin,no-such-lens", "--sheet", "a.png"]].concat());
    assert!(
        message.contains("picture 2 of 2") && message.contains("no-such-lens") && !message.contains("1 of 2:"),
        "{code} {message}"
    );
}

#[test]
fn lessons_are_pages_with_figures_and_tables() {
    let f = Folder::new("lesson");
    let listed: Value = serde_json::from_slice(&f.ok(&["lesson", "list", "--json"]).stdout).unwrap();
    assert!(listed.as_array().unwrap().len() >= 15, "{listed}");
    let told: Value = serde_json::from_slice(&f.ok(&["lesson", "thin-lens", "-o", "out", "--json"]).stdout).unwrap();
    for file in told["lessons"][0]["files"].as_array().unwrap() {
        let path = f.path(file.as_str().unwrap());
        assert!(path.is_file(), "{}", path.display());
    }
    // The same on paper: a file, and nothing beside it.
    f.ok(&["lesson", "thin-lens", "-o", "thin-lens.pdf"]);
    let figures = told["lessons"][0]["files"].as_array().unwrap().len() - 1;
    assert_eq!(pictures(&f.read("thin-lens.pdf")), figures);
    assert!(!f.path("thin-lens-equal.png").exists());
    let page = String::from_utf8(f.read("out/thin-lens.md")).unwrap();
    assert!(page.contains("](thin-lens-equal.png)") && page.contains("diopter calc thin-lens"), "{page}");
    // Photographs in another size; a table as it is printed.
    f.ok(&["lesson", "gamma", "-o", "out", "--size", "24x16"]);
    let figure = f.read("out/gamma-encodings.png");
    assert_eq!(size_of(&figure)[0], 12 + 5 * 36);
    f.ok(&["lesson", "gamma", "-o", "out", "--size", "24x16"]);
    assert!(figure == f.read("out/gamma-encodings.png"), "the same lesson is another picture");
    f.ok(&["lesson", "formats", "-o", "out"]);
    let page = String::from_utf8(f.read("out/formats.md")).unwrap();
    let table = String::from_utf8(f.ok(&["calc", "formats"]).stdout).unwrap();
    assert!(page.contains(table.trim_end()), "{page}");
    for (args, said) in [
        (&["lesson", "gama", "-o", "x"][..], "did you mean \"gamma\""),
        (&["lesson", "gamma"], "-o FOLDER"),
        (&["lesson", "gamma", "-o", "out/gamma.md"], "a folder"),
    ] {
        let (code, message) = f.fails(args);
        assert!(code == 2 && message.contains(said), "{args:?}: {message}");
    }
}
