//! Commands of a sequence file and their words.

/// Commands with their line numbers.
pub(super) fn commands(text: &str) -> Vec<(usize, String)> {
    let mut commands = vec![];
    let mut open: Option<(usize, String)> = None;
    for (number, line) in text.lines().enumerate() {
        let code = without_comment(line);
        let (start, mut whole) = open.take().unwrap_or((number + 1, String::new()));
        match code.trim_end().strip_suffix('&') {
            Some(part) => {
                whole.push_str(part);
                whole.push(' ');
                open = Some((start, whole));
            }
            None => {
                whole.push_str(code);
                commands.extend(split(&whole).into_iter().map(|c| (start, c)));
            }
        }
    }
    commands.extend(open.into_iter().flat_map(|(start, whole)| split(&whole).into_iter().map(move |c| (start, c))));
    commands
}

pub(super) fn without_comment(line: &str) -> &str {
    let mut quote = None;
    for (i, c) in line.char_indices() {
        match (quote, c) {
            (None, '!') => return &line[..i],
            (None, '\'' | '"') => quote = Some(c),
            (Some(q), c) if q == c => quote = None,
            _ => {}
        }
    }
    line
}

/// At semicolons outside quotes.
pub(super) fn split(line: &str) -> Vec<String> {
    let mut parts = vec![String::new()];
    let mut quote = None;
    for c in line.chars() {
        match (quote, c) {
            (None, ';') => parts.push(String::new()),
            _ => {
                quote = match (quote, c) {
                    (None, '\'' | '"') => Some(c),
                    (Some(q), c) if q == c => None,
                    (q, _) => q,
                };
                if let Some(last) = parts.last_mut() {
                    last.push(c);
                }
            }
        }
    }
    parts
}

pub(super) fn words(command: &str) -> Vec<String> {
    let mut words: Vec<String> = vec![];
    let mut quote: Option<char> = None;
    let mut fresh = true;
    for c in command.chars() {
        if quote.is_none() && c.is_whitespace() {
            fresh = true;
            continue;
        }
        if fresh {
            words.push(String::new());
            fresh = false;
        }
        quote = match (quote, c) {
            (None, '\'' | '"') => Some(c),
            (Some(q), c) if q == c => None,
            (q, _) => q,
        };
        if let Some(w) = words.last_mut() {
            w.push(c);
        }
    }
    words
}

/// Words that say which surface, zoom position, wavelength or aperture is meant.
pub(super) fn is_qualifier(word: &str) -> bool {
    let upper = word.to_uppercase();
    let counted = |digits: &str| !digits.is_empty() && digits.chars().all(|c| c.is_ascii_digit());
    matches!(upper.as_str(), "CLR" | "EDG" | "OBS" | "HOL" | "SO" | "SI" | "SS")
        || upper.strip_prefix(['S', 'Z', 'W', 'C', 'L']).is_some_and(counted)
        || upper.strip_prefix('L').is_some_and(|label| label.starts_with(['\'', '"']))
}

/// n of "Sn".
pub(super) fn surface_number(word: &str) -> Option<usize> {
    let digits = word.strip_prefix(['S', 's'])?;
    digits.parse().ok().filter(|_| digits.chars().all(|c| c.is_ascii_digit()))
}
