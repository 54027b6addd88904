//! Rust sources as the layout test sees them: code without comments and literals, and where each function begins and ends.

/// What the scanner is in.
#[derive(Clone, Copy, PartialEq)]
enum In {
    Code,
    Line,
    Block(u32),
    Text,
    Raw(usize),
}

/// The code of a source: comments and the insides of literals are blanks, line breaks stay where they were.
pub fn code_of(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let mut code = String::with_capacity(text.len());
    let mut state = In::Code;
    let mut at = 0;
    while at < chars.len() {
        let (next, length) = advance(state, &chars, at);
        let keep = state == In::Code && next == In::Code && length == 1;
        for c in &chars[at..(at + length).min(chars.len())] {
            code.push(if keep || *c == '\n' { *c } else { ' ' });
        }
        (state, at) = (next, at + length);
    }
    code
}

/// The state after what stands at `at`, and how many characters that takes.
fn advance(state: In, chars: &[char], at: usize) -> (In, usize) {
    let c = chars[at];
    let follow = chars.get(at + 1).copied().unwrap_or(' ');
    match state {
        In::Code => advance_in_code(chars, at),
        In::Line if c == '\n' => (In::Code, 1),
        In::Line => (In::Line, 1),
        In::Block(depth) if (c, follow) == ('/', '*') => (In::Block(depth + 1), 2),
        In::Block(depth) if (c, follow) == ('*', '/') => (if depth == 1 { In::Code } else { In::Block(depth - 1) }, 2),
        In::Block(depth) => (In::Block(depth), 1),
        In::Text if c == '\\' => (In::Text, 2),
        In::Text if c == '"' => (In::Code, 1),
        In::Text => (In::Text, 1),
        In::Raw(hashes) if c == '"' && hashes_at(chars, at + 1) >= hashes => (In::Code, 1 + hashes),
        In::Raw(hashes) => (In::Raw(hashes), 1),
    }
}

fn advance_in_code(chars: &[char], at: usize) -> (In, usize) {
    let follow = chars.get(at + 1).copied().unwrap_or(' ');
    let after_word = at > 0 && (chars[at - 1].is_alphanumeric() || chars[at - 1] == '_') && chars[at - 1] != 'b';
    match (chars[at], follow) {
        ('/', '/') => (In::Line, 2),
        ('/', '*') => (In::Block(1), 2),
        ('"', _) => (In::Text, 1),
        ('r', '"' | '#') if !after_word => {
            let hashes = hashes_at(chars, at + 1);
            if chars.get(at + 1 + hashes) == Some(&'"') { (In::Raw(hashes), 2 + hashes) } else { (In::Code, 1) }
        }
        ('\'', '\\') => {
            let end = (at + 3..chars.len()).find(|&end| chars[end] == '\'').unwrap_or(chars.len() - 1);
            (In::Code, end + 1 - at)
        }
        ('\'', _) if chars.get(at + 2) == Some(&'\'') => (In::Code, 3),
        _ => (In::Code, 1),
    }
}

fn hashes_at(chars: &[char], at: usize) -> usize {
    chars[at.min(chars.len())..].iter().take_while(|c| **c == '#').count()
}

/// Whether the code has this word.
pub fn has_word(code: &str, word: &str) -> bool {
    code.split(|c: char| !c.is_alphanumeric() && c != '_').any(|found| found == word)
}

/// A function: name, line of its `fn`, number of lines from there to its closing brace.
#[derive(Debug, PartialEq)]
pub struct Function {
    pub name: String,
    pub line: usize,
    pub lines: usize,
}

/// The functions that have a body, in the order of their ends.
pub fn functions(code: &str) -> Vec<Function> {
    let mut done = Vec::new();
    let mut open: Vec<(String, usize, usize)> = Vec::new();
    let mut announced: Option<(String, usize)> = None;
    let (mut line, mut braces, mut brackets) = (1, 0usize, 0usize);
    let mut word = String::new();
    let mut before = String::new();
    for c in code.chars() {
        if c.is_alphanumeric() || c == '_' {
            word.push(c);
            continue;
        }
        if !word.is_empty() {
            if before == "fn" {
                announced = Some((std::mem::take(&mut word), line));
            }
            before = std::mem::take(&mut word);
        }
        match c {
            '\n' => line += 1,
            '(' | '[' => {
                brackets += 1;
                before.clear(); // `fn(` is a type
            }
            ')' | ']' => brackets = brackets.saturating_sub(1),
            ';' if brackets == 0 => announced = None,
            '{' => {
                braces += 1;
                if let Some((name, begin)) = announced.take() {
                    open.push((name, begin, braces));
                }
            }
            '}' => {
                if open.last().is_some_and(|(_, _, depth)| *depth == braces) {
                    done.extend(open.pop().map(|(name, begin, _)| Function { name, line: begin, lines: line + 1 - begin }));
                }
                braces = braces.saturating_sub(1);
            }
            _ => {}
        }
    }
    done
}

#[test]
fn comments_and_literals_are_no_code_and_functions_are_measured() {
    let text = "//! unsafe\nfn a(x: [u8; 4]) -> char {\n    /* unsafe /* */ { */ let s = \"un\\\"safe {\"; '{'\n}\ntrait T { fn b(&self); }\n\
                fn c<'a>(f: fn(&'a str), r: &str) {\n    let _ = r#\"}\"#;\n    fn d() {}\n}\n";
    let code = code_of(text);
    assert!(!has_word(&code, "unsafe"), "{code}");
    assert!(has_word(&code_of("unsafe { x }"), "unsafe"));
    let found: Vec<_> = functions(&code).into_iter().map(|f| (f.name, f.line, f.lines)).collect();
    assert_eq!(found, [("a".into(), 2, 3), ("d".into(), 8, 1), ("c".into(), 6, 4)]);
}
