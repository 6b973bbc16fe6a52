//! One colour a method and one a stage, the same in every figure.

use crate::config::presets;

/// Colours that [`style.css`](self) has: `f0` to `f9` fill, `s0` to `s9` stroke.
const COLORS: usize = 10;

/// Methods by colour. Others take one of those that are left, by their name.
const KNOWN: [&str; 7] =
    ["ours", "ours-fast", "gr12", "gr14", "reference-sphere", "ours-mobile", "ours-fast-mobile"];

/// Number of the colour of a method or preset.
pub(in crate::report) fn class_of(method: &str) -> usize {
    if let Some(i) = KNOWN.iter().position(|known| *known == method) {
        return i;
    }
    let others = presets::ALL.iter().filter(|p| !KNOWN.contains(&p.name));
    let left = COLORS - KNOWN.len();
    let place = others.enumerate().find(|(_, p)| p.name == method).map(|(i, _)| i);
    KNOWN.len() + place.unwrap_or_else(|| method.bytes().map(usize::from).sum()) % left
}

/// Class of a stage's bar, by its place in [`crate::timing::Stage::ALL`].
pub(in crate::report) fn stage_class(stage: usize) -> String {
    format!("g{stage}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn methods_of_the_paper_differ_and_every_name_has_a_colour() {
        let colors: HashSet<usize> = KNOWN.iter().map(|m| class_of(m)).collect();
        assert_eq!(colors.len(), KNOWN.len());
        for name in ["", "something else", "ours-slow"] {
            assert!((KNOWN.len()..COLORS).contains(&class_of(name)), "{name}");
        }
    }
}
