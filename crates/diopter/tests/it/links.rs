//! Relative links of the documents lead to files that are there. No network: addresses elsewhere are left alone.

use std::path::{Path, PathBuf};

/// Markdown files of a folder and those below.
fn documents(folder: &Path, to: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            documents(&path, to);
        } else if path.extension().is_some_and(|e| e == "md") {
            to.push(path);
        }
    }
}

/// Targets of the links and pictures of a text, without what stands in code.
fn targets(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut in_block = false;
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            in_block = !in_block;
            continue;
        }
        if in_block {
            continue;
        }
        // Every second piece between backticks is code.
        let prose: String = line.split('`').step_by(2).collect::<Vec<_>>().join("code");
        found.extend(prose.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0.to_owned())));
        // Pictures and links as HTML.
        for attribute in ["src=\"", "href=\""] {
            found.extend(prose.split(attribute).skip(1).filter_map(|rest| Some(rest.split_once('"')?.0.to_owned())));
        }
    }
    found
}

/// The file that a link means, if it is one of ours.
fn file_of(document: &Path, target: &str) -> Option<PathBuf> {
    // `<a b.md>` and `a.md "title"`.
    let target = target.trim().trim_start_matches('<');
    let target = target.split([' ', '>']).next().unwrap_or_default();
    let path = target.split('#').next().unwrap_or_default();
    (!path.is_empty() && !path.contains("://") && !path.starts_with("mailto:")).then(|| document.with_file_name("").join(path))
}

#[test]
fn links_of_the_documents_resolve() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut all: Vec<PathBuf> = ["README.md", "ARCHITECTURE.md", "STYLE.md"].iter().map(|n| root.join(n)).collect();
    documents(&root.join("docs"), &mut all);
    let (mut broken, mut count) = (Vec::new(), 0);
    for document in all.iter().filter(|p| p.exists()) {
        for target in targets(&std::fs::read_to_string(document).unwrap()) {
            let Some(file) = file_of(document, &target) else { continue };
            count += 1;
            if !file.exists() {
                broken.push(format!("{}: {target}", document.display()));
            }
        }
    }
    assert!(count > 10, "only {count} links found");
    assert!(broken.is_empty(), "links to files that are not there:\n{}", broken.join("\n"));
}

#[test]
fn links_are_found_and_code_is_not() {
    let text =
        "a [b](c.md#d) and `[x](no.md)`, ![e](f.png \"g\")\n```\n[h](no.md)\n```\n<img src=\"i.png\"> [web](https://a.b/c)";
    let found = targets(text);
    assert_eq!(found, ["c.md#d", "f.png \"g\"", "https://a.b/c", "i.png"]);
    let document = Path::new("docs/a.md");
    let files: Vec<PathBuf> = found.iter().filter_map(|t| file_of(document, t)).collect();
    assert_eq!(files, ["docs/c.md", "docs/f.png", "docs/i.png"].map(PathBuf::from));
}
