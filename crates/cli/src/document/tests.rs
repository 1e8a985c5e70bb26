use super::*;
use diopter::image::{Encoding, Raster};
use diopter::light::color::RgbSpace;
use miniz_oxide::inflate::decompress_to_vec_zlib;

fn picture(width: usize, height: usize) -> Picture {
    let data = (0..width * height).flat_map(|i| [(i % width) as f32 / width as f32, (i / width) as f32 / height as f32, 0.5]);
    let pixels = Raster { width, height, channels: 3, data: data.collect() };
    Picture { pixels, space: RgbSpace::Srgb, encoding: Encoding::Srgb, facts: None }
}

fn document() -> Document {
    let mut d = Document { title: "A & B".into(), ..Document::default() };
    let mut figure = Figure::new(100.0, 50.0);
    figure.text(glam::DVec2::new(10.0, 10.0), "axis µm", 8.0, diopter::lens::draw::Anchor::Middle);
    d.section("MTF <50>", &[figure], "a < b\n  c");
    d.blocks.push(Block::Picture { picture: picture(60, 40).into(), marked: Some([0.5, 0.5]) });
    d.blocks.push(Block::Bars(vec![("a < b".into(), 0.5), ("less".into(), -3.0)]));
    d.blocks.push(Block::Rows { rows: vec![vec!["n".into(), "x".into()], vec!["1".into(), "2".into()]], head: true });
    let cell = |k: usize| (picture(60, 40), format!("iso {k}"), "f/2 <b>".to_owned());
    d.blocks.push(Block::Contacts { columns: 2, cells: (0..3).map(cell).collect() });
    d
}

#[test]
fn html_holds_its_pictures_and_escapes_its_text() {
    let html = document().html().unwrap();
    assert!(html.contains("<title>A &amp; B</title>") && html.contains("<h2>MTF &lt;50&gt;</h2>") && html.contains("a &lt; b"));
    assert_eq!(html.matches("data:image/png;base64,").count(), 4);
    assert!(html.contains("<svg ") && !html.contains("href=") && !html.contains("src=\"http"));
    assert!(html.contains("width:25.0%") && html.contains("class=\"less\" style=\"width:50.0%\""));
}

/// Streams of a PDF that are packed by zlib, unpacked.
fn streams(pdf: &[u8]) -> Vec<Vec<u8>> {
    let find = |from: usize, what: &[u8]| pdf[from..].windows(what.len()).position(|w| w == what).map(|k| from + k);
    let (mut all, mut at) = (Vec::new(), 0);
    while let Some(start) = find(at, b"\nstream\n") {
        let Some(end) = find(start, b"\nendstream") else { break };
        all.extend(decompress_to_vec_zlib(&pdf[start + 8..end]));
        at = end;
    }
    all
}

#[test]
fn pdf_has_the_text_as_text_the_pictures_as_pictures_and_is_the_same_each_time() {
    let bytes = document().pdf().unwrap();
    assert_eq!(bytes, document().pdf().unwrap());
    assert!(bytes.starts_with(b"%PDF-") && bytes.ends_with(b"%%EOF"));
    let count = |what: &[u8]| bytes.windows(what.len()).filter(|w| *w == what).count();
    assert_eq!(count(b"/Subtype /Image"), 4);
    assert_eq!(count(b"/Type /Page\n") + count(b"/Type /Page "), 1);
    // Three fonts, cut down: those of DejaVu have 757, 706 and 340 kB.
    assert_eq!(count(b"/FontFile2"), 3);
    assert!(bytes.len() < 150_000, "{}", bytes.len());
    // What glyphs stand for: the micro sign of the drawing and the letters of the table.
    let text = String::from_utf8_lossy(&bytes).into_owned();
    for letter in ['µ', '<', 'c', '%'] {
        let code = format!("<{:04X}>", u32::from(letter));
        assert!(text.to_uppercase().contains(&code), "{letter}");
    }
    // Every operator q has its Q.
    let page = streams(&bytes).into_iter().find(|s| s.windows(3).any(|w| w == b"\nBT")).unwrap();
    let lines = |what: &str| String::from_utf8_lossy(&page).lines().filter(|l| l.trim_end() == what).count();
    assert!(lines("q") == lines("Q") && lines("BT") == lines("ET") && lines("BT") > 10, "{} {}", lines("q"), lines("Q"));
}

#[test]
fn long_text_takes_as_many_sheets_as_it_needs() {
    let mut d = Document { title: "long".into(), ..Document::default() };
    d.blocks.push(Block::Fixed("a line\n".repeat(500)));
    d.blocks.push(Block::Paragraph(format!("word {}", "x".repeat(5000))));
    let bytes = d.pdf().unwrap();
    // 500 lines of 7.6 × 1.35 points on sheets of 758 points, and a word that is broken.
    let sheets = bytes.windows(12).filter(|w| *w == b"/Type /Page\n").count();
    assert!((7..=12).contains(&sheets), "{sheets}");
}
