//! Any text as a recipe: an error or a recipe that can be written and read again, never a panic.
#![no_main]

use diopter_develop::Recipe;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    if let Ok(text) = std::str::from_utf8(data)
        && let Ok(recipe) = Recipe::from_toml(text)
    {
        assert_eq!(Recipe::from_toml(&recipe.to_toml()).expect("what was written can be read"), recipe);
    }
});
