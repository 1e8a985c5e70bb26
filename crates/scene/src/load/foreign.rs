//! Files of other programs that are not read, and the way to one that is.

/// Endings, first bytes, what the file is, and what makes it a file that is read.
type Known = (&'static [&'static str], &'static [&'static [u8]], &'static str, &'static str);

/// What other programs write.
const KNOWN: &[Known] = &[
    (&["blend", "blend1"], &[b"BLENDER"], "a Blender project", "in Blender: File > Export > glTF 2.0 (.glb) or USD (.usdc)"),
    (&["fbx"], &[b"Kaydara FBX Binary", b"; FBX"], "an FBX file", "import it into Blender and export it as .glb or .usdc"),
    (&["dae"], &[], "a COLLADA file", "import it into Blender (before 5.0) or another program and export it as .glb or .usdc"),
    (&["abc"], &[b"Ogawa"], "an Alembic cache", "import it into Blender and export it as .usdc or .glb"),
    (&["3mf"], &[], "a 3MF file", "a slicer or CAD program writes it as .stl or .obj"),
    (
        &["step", "stp"],
        &[b"ISO-10303-21"],
        "a STEP model: exact surfaces without triangles",
        "a CAD program (FreeCAD: File > Export) writes it as .glb, .obj or .stl",
    ),
    (
        &["iges", "igs", "brep", "sldprt", "sldasm", "ipt", "3dm"],
        &[b"3D Geometry File Format"],
        "a CAD model: exact surfaces without triangles",
        "a CAD program writes it as .glb, .obj or .stl",
    ),
    (&["ma"], &[b"//Maya ASCII"], "a Maya scene", "in Maya: File > Export as USD (.usdc)"),
    (&["mb"], &[b"FOR4", b"FOR8"], "a Maya scene", "in Maya: File > Export as USD (.usdc)"),
    (&["max"], &[], "a 3ds Max scene", "in 3ds Max: File > Export as USD (.usdc)"),
    (&["c4d"], &[b"QC4DC4D6"], "a Cinema 4D scene", "in Cinema 4D: File > Export as USD (.usdc) or glTF (.glb)"),
    (&["hip", "hiplc", "hipnc"], &[], "a Houdini scene", "in Houdini: a USD ROP writes it as .usdc"),
    (
        &["3ds", "lwo", "skp", "x3d", "wrl", "vrml"],
        &[b"#VRML"],
        "a file of another format",
        "import it into Blender and export it as .glb or .usdc",
    ),
    (&["vdb", "nvdb"], &[b" BDV"], "a volume", "a scene file (pbrt) that places it"),
];

/// What a file is that is not read, and what makes one of it that is: by its ending (lower case) or its first bytes.
pub fn foreign(ending: &str, bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let by_bytes = |starts: &[&[u8]]| starts.iter().any(|s| bytes.starts_with(s));
    let known = KNOWN.iter().find(|k| by_bytes(k.1)).or_else(|| KNOWN.iter().find(|k| k.0.contains(&ending)));
    let of_ending = |ending: &str| KNOWN.iter().find(|k| k.0.contains(&ending));
    // What is text or an archive says further on what it is.
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]);
    let told = match bytes {
        [b'P', b'K', 3, 4, ..] if head.contains("3D/3dmodel.model") => of_ending("3mf"),
        [b'<' | 0xef, ..] if head.contains("<COLLADA") => of_ending("dae"),
        _ => None,
    };
    told.or(known).map(|k| (k.2, k.3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_other_programs_are_known_by_ending_and_by_content() {
        for (ending, bytes, word) in [
            ("blend", &b""[..], "Blender"),
            ("glb", b"BLENDER-v300", "Blender"),
            ("obj", b"Kaydara FBX Binary  \0", "FBX"),
            ("xml", b"<?xml version=\"1.0\"?>\n<COLLADA xmlns=\"\">", "COLLADA"),
            ("usdz", b"PK\x03\x04........3D/3dmodel.model", "3MF"),
            ("stp", b"ISO-10303-21;", "STEP"),
            ("abc", b"", "Alembic"),
        ] {
            assert!(foreign(ending, bytes).unwrap().0.contains(word), "{ending}");
        }
        for (ending, bytes) in [("obj", &b"v 0 0 0"[..]), ("xml", b"<scene/>"), ("usdz", b"PK\x03\x04a.usda"), ("", b"")] {
            assert!(foreign(ending, bytes).is_none(), "{ending}");
        }
    }
}
