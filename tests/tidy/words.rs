//! Words, names and numbers in texts.

use std::collections::BTreeSet;

use super::repository::File;

/// Names that fit anything and so say nothing.
pub(crate) const CATCH_ALL: [&str; 9] =
    ["mod", "util", "utils", "common", "types", "misc", "helper", "helpers", "shared"];

/// Whether `word` stands in `text` and is not part of a longer name.
pub(crate) fn has_word(text: &str, word: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(word).any(|(at, _)| {
        !text[..at].ends_with(is_part) && !text[at + word.len()..].starts_with(is_part)
    })
}

/// `4.22` or `4.10-4.12` as numbers of the thesis' equations.
pub(crate) fn equation_numbers(token: &str) -> Vec<(u32, u32)> {
    let number = |text: &str| {
        let (chapter, number) = text.split_once('.')?;
        let pair = (chapter.parse().ok()?, number.parse().ok()?);
        (3..=4).contains(&pair.0).then_some(pair)
    };
    let token = token.trim_matches(|c: char| !c.is_ascii_digit());
    let (first, last) = token.split_once('-').unwrap_or((token, token));
    match (number(first), number(last)) {
        (Some(first), Some(last)) => (first.1..=last.1).map(|n| (first.0, n)).collect(),
        _ => Vec::new(),
    }
}

/// The comments of Rust code as one text.
pub(crate) fn comments(code: &str) -> String {
    let comments = code.lines().filter_map(|line| line.split_once("//"));
    let texts = comments.map(|(_, comment)| comment.trim_start_matches(['/', '!']));
    texts.collect::<Vec<_>>().join(" ")
}

/// Equations that the comments of `file` quote: numbers after the word `equation`, and in brackets.
pub(crate) fn quoted_equations(file: &File) -> BTreeSet<(u32, u32)> {
    let mut quoted = BTreeSet::new();
    let mut is_list = false;
    for token in comments(&file.text).split_whitespace() {
        let numbers = equation_numbers(token);
        let is_bracketed = token.starts_with('(') && token.contains(')');
        if is_bracketed || is_list {
            quoted.extend(&numbers);
        }
        is_list = token.trim_matches('(').starts_with("equation")
            || (is_list && (!numbers.is_empty() || token == "and"));
    }
    quoted
}

/// Keys of a JSON text.
pub(crate) fn keys(json: &str) -> BTreeSet<&str> {
    let strings = json.split('"').collect::<Vec<_>>();
    let inside = strings.windows(2).skip(1).step_by(2);
    inside.filter(|pair| pair[1].trim_start().starts_with(':')).map(|pair| pair[0]).collect()
}

/// `BatteryLow` as `battery_low`, its name in logs.
pub(crate) fn snake_case(name: &str) -> String {
    let mut snake = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !snake.is_empty() {
            snake.push('_');
        }
        snake.extend(letter.to_lowercase());
    }
    snake
}
