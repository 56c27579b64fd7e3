//! Conditions of `IfBegin` and `ElseIf`.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use super::Reader;
use super::request::{Argument, Request, RibResult};

/// A value of a condition.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    Number(f64),
    Text(String),
}

impl Value {
    fn number(&self) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Text(text) => text.trim().parse().unwrap_or(0.0),
        }
    }

    pub(super) fn is_true(&self) -> bool {
        match self {
            Self::Number(number) => *number != 0.0,
            Self::Text(text) => text.trim().parse::<f64>().map_or(!text.is_empty(), |number| number != 0.0),
        }
    }
}

/// Variables: attributes and options such as `user:pass`, by their names without type.
pub(super) type Variables = Arc<HashMap<String, Value>>;

/// An open `IfBegin`.
pub(super) struct Branch {
    pub line: usize,
    /// Whether a branch has been executed.
    pub done: bool,
    /// Whether the current branch is executed.
    pub active: bool,
}

impl Reader {
    /// Executes a request of a conditional; `true` for these and for all requests of a branch that is not taken.
    pub(super) fn condition(&mut self, request: &Request, path: &Path) -> RibResult<bool> {
        let is_active = |branches: &[Branch]| branches.last().is_none_or(|branch| branch.active);
        let name = request.name.as_str();
        match name {
            "IfBegin" => {
                let outer = is_active(&self.branches);
                let active = outer && self.is_true(request, path);
                self.branches.push(Branch { line: request.line, done: active || !outer, active });
            }
            "ElseIf" | "Else" => {
                let done = self.branches.last().ok_or("there is no IfBegin before it")?.done;
                let active = !done && (name == "Else" || self.is_true(request, path));
                if let Some(branch) = self.branches.last_mut() {
                    (branch.active, branch.done) = (active, done || active);
                }
            }
            "IfEnd" => {
                self.branches.pop().ok_or("there is no IfBegin before it")?;
            }
            _ => return Ok(!is_active(&self.branches)),
        }
        Ok(true)
    }

    fn is_true(&mut self, request: &Request, path: &Path) -> bool {
        let text = match request.arguments.first() {
            Some(Argument::Text(text)) => text.clone(),
            Some(Argument::Number(number)) => number.to_string(),
            _ => String::new(),
        };
        let (attributes, options) = (&self.attributes.variables, &self.variables);
        // Names may begin with their kind: Attribute:user:pass, Option:user:pass
        let value = |name: &str| {
            let bare = name.trim_start_matches("Attribute:").trim_start_matches("Option:");
            let find = |name: &str| attributes.get(name).or(options.get(name)).cloned();
            find(bare).or_else(|| find(&format!("user:{bare}")))
        };
        evaluate(&text, &value).map(|value| value.is_true()).unwrap_or_else(|problem| {
            self.note(format!("the condition counts as false: {problem}"), request.line, path);
            false
        })
    }
}

/// Evaluates a condition, such as `$user:pass == 'beauty' && !defined(quick)`.
///
/// # Errors
/// What is wrong with it.
fn evaluate(text: &str, variables: &dyn Fn(&str) -> Option<Value>) -> Result<Value, String> {
    let mut parser = Parser { tokens: tokens(text)?, at: 0, variables, depth: 0 };
    if parser.tokens.is_empty() {
        return Ok(Value::Number(0.0));
    }
    let value = parser.binary(0)?;
    match parser.tokens.get(parser.at) {
        None => Ok(value),
        Some(token) => Err(format!("{text:?}: found {token:?}, expected an operator")),
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Value(Value),
    /// A variable with `$`.
    Variable(String),
    /// A name without `$`: a string, or `defined`.
    Word(String),
    Sign(&'static str),
}

/// Longer signs first.
const SIGNS: &[&str] = &["==", "!=", "<=", ">=", "&&", "||", "=~", "!", "<", ">", "(", ")", "+", "-", "*", "/"];

/// Binary operators, weakest first.
const LEVELS: &[&[&str]] = &[&["||"], &["&&"], &["==", "!=", "=~"], &["<", ">", "<=", ">="], &["+", "-"], &["*", "/"]];

/// Maximum nesting of parentheses and negations.
const MAX_DEPTH: usize = 64;

fn tokens(text: &str) -> Result<Vec<Token>, String> {
    let mut found = Vec::new();
    let mut rest = text.trim_start();
    while let Some(first) = rest.chars().next() {
        let word_end = |from: &str| {
            from.find(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | ':' | '.'))).unwrap_or(from.len())
        };
        let (token, length) = if first == '\'' || first == '"' {
            let end = rest[1..].find(first).ok_or_else(|| format!("{text:?}: a string is not closed"))?;
            (Token::Value(Value::Text(rest[1..=end].into())), end + 2)
        } else if first == '$' {
            let braced = rest[1..].starts_with('{');
            let start = if braced { 2 } else { 1 };
            let end = start + word_end(&rest[start..]);
            (Token::Variable(rest[start..end].into()), if braced { (end + 1).min(rest.len()) } else { end })
        } else if first.is_ascii_digit() || (first == '.' && rest.len() > 1) {
            let end = rest.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(rest.len());
            let number = rest[..end].parse().map_err(|_| format!("{text:?}: found {:?}", &rest[..end]))?;
            (Token::Value(Value::Number(number)), end)
        } else if first.is_alphabetic() || first == '_' {
            let end = word_end(rest);
            (Token::Word(rest[..end].into()), end)
        } else if let Some(sign) = SIGNS.iter().find(|sign| rest.starts_with(**sign)) {
            (Token::Sign(sign), sign.len())
        } else {
            return Err(format!("{text:?}: found {first:?}"));
        };
        found.push(token);
        rest = rest.get(length..).unwrap_or("").trim_start();
    }
    Ok(found)
}

struct Parser<'a> {
    tokens: Vec<Token>,
    at: usize,
    variables: &'a dyn Fn(&str) -> Option<Value>,
    depth: usize,
}

impl Parser<'_> {
    fn binary(&mut self, level: usize) -> Result<Value, String> {
        let Some(signs) = LEVELS.get(level) else { return self.unary() };
        let mut left = self.binary(level + 1)?;
        while let Some(Token::Sign(sign)) = self.tokens.get(self.at)
            && signs.contains(sign)
        {
            let sign = *sign;
            self.at += 1;
            let right = self.binary(level + 1)?;
            left = combine(sign, &left, &right);
        }
        Ok(left)
    }

    fn unary(&mut self) -> Result<Value, String> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(format!("a condition is nested more than {MAX_DEPTH} deep"));
        }
        let token = self.tokens.get(self.at).cloned().ok_or("a condition ends too early")?;
        self.at += 1;
        let value = match token {
            Token::Value(value) => value,
            Token::Variable(name) => (self.variables)(&name).unwrap_or(Value::Text(String::new())),
            Token::Word(word) if word == "defined" => {
                let opened = self.skip("(");
                let name = match self.tokens.get(self.at) {
                    Some(Token::Word(name) | Token::Variable(name) | Token::Value(Value::Text(name))) => name.clone(),
                    other => return Err(format!("defined: found {other:?}, expected a name")),
                };
                self.at += 1;
                if opened && !self.skip(")") {
                    return Err("expected ) after the name of defined".into());
                }
                truth((self.variables)(&name).is_some())
            }
            Token::Word(word) => Value::Text(word),
            Token::Sign("!") => truth(!self.unary()?.is_true()),
            Token::Sign("-") => Value::Number(-self.unary()?.number()),
            Token::Sign("(") => {
                let value = self.binary(0)?;
                if !self.skip(")") {
                    return Err("a parenthesis is not closed".into());
                }
                value
            }
            Token::Sign(sign) => return Err(format!("found {sign:?}, expected a value")),
        };
        self.depth -= 1;
        Ok(value)
    }

    fn skip(&mut self, sign: &str) -> bool {
        let found = matches!(self.tokens.get(self.at), Some(Token::Sign(s)) if *s == sign);
        self.at += usize::from(found);
        found
    }
}

fn truth(value: bool) -> Value {
    Value::Number(f64::from(u8::from(value)))
}

fn combine(sign: &str, left: &Value, right: &Value) -> Value {
    let (a, b) = (left.number(), right.number());
    let equal = match (left, right) {
        (Value::Text(a), Value::Text(b)) => a == b,
        _ => a == b,
    };
    match sign {
        "||" => truth(left.is_true() || right.is_true()),
        "&&" => truth(left.is_true() && right.is_true()),
        "==" => truth(equal),
        "!=" => truth(!equal),
        "=~" => truth(matches(left, right)),
        "<" => truth(a < b),
        ">" => truth(a > b),
        "<=" => truth(a <= b),
        ">=" => truth(a >= b),
        "+" => Value::Number(a + b),
        "-" => Value::Number(a - b),
        "*" => Value::Number(a * b),
        _ => Value::Number(a / b),
    }
}

/// Whether a string matches a pattern with `*` and `?`, or contains a pattern without them.
fn matches(text: &Value, pattern: &Value) -> bool {
    let (Value::Text(text), Value::Text(pattern)) = (text, pattern) else { return text.number() == pattern.number() };
    if !pattern.contains(['*', '?']) {
        return text.contains(pattern.as_str());
    }
    let (text, pattern): (Vec<char>, Vec<char>) = (text.chars().collect(), pattern.chars().collect());
    // which beginnings of the text the beginning of the pattern matches
    let mut reached = vec![false; text.len() + 1];
    reached[0] = true;
    for &p in &pattern {
        let mut next = vec![false; text.len() + 1];
        for i in 0..=text.len() {
            next[i] = match p {
                '*' => reached[i] || (i > 0 && next[i - 1]),
                _ => i > 0 && reached[i - 1] && (p == '?' || p == text[i - 1]),
            };
        }
        reached = next;
    }
    reached[text.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_true(text: &str) -> Result<bool, String> {
        let variables = |name: &str| match name {
            "user:pass" => Some(Value::Text("beauty".into())),
            "Frame" => Some(Value::Number(7.0)),
            _ => None,
        };
        evaluate(text, &variables).map(|value| value.is_true())
    }

    #[test]
    fn conditions_are_evaluated() {
        for text in [
            "1",
            "-1",
            "$user:pass == 'beauty'",
            "$user:pass != \"bake\" && $Frame > 6.5",
            "${Frame} == 7",
            "!0 || $nothing",
            "defined(Frame) && !defined(nothing)",
            "$user:pass =~ 'bea*'",
            "$user:pass =~ 'aut'",
            "$user:pass == beauty",
            "(2 + 3) * 2 - 1 == 9",
        ] {
            assert_eq!(is_true(text), Ok(true), "{text}");
        }
        for text in
            ["0", "", "$nothing", "$user:pass == 'bake'", "$Frame < 7 || 0", "!($Frame == 7)", "$user:pass =~ 'b?'"]
        {
            assert_eq!(is_true(text), Ok(false), "{text}");
        }
    }

    #[test]
    fn wrong_conditions_are_errors() {
        for text in ["(1", "1 2", "'open", "&& 1", "#", "defined(3)", &"(".repeat(10_000)] {
            assert!(is_true(text).is_err(), "{text}");
        }
    }
}
