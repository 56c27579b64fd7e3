//! The language that materials are written in before they are printed as a shader.
//!
//! It is a subset of GLSL ES 3.00 that every target can express: constants and functions of scalars and vectors; local
//! variables, `if`, counted loops with `break`, and one `return` at the end. There are no arrays, structures, textures or
//! uniforms. Functions that only a target can write, such as the reading of a texture, are called without a definition.

use crate::{Error, Result};

/// A program.
#[derive(Debug, Default, PartialEq)]
pub(in crate::renderers) struct Program {
    pub items: Vec<Item>,
}

/// A definition, with the comment above it.
#[derive(Debug, PartialEq)]
pub(in crate::renderers) struct Item {
    pub comment: Vec<String>,
    pub name: String,
    pub definition: Definition,
}

#[derive(Debug, PartialEq)]
pub(in crate::renderers) enum Definition {
    Constant(Type, Expr),
    Function { result: Type, params: Vec<(Type, String)>, body: Vec<Stmt> },
}

/// A type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::renderers) enum Type {
    Bool,
    Int,
    Float,
    /// Floating-point vector of 2 to 4.
    Vec(u8),
    /// Vector of 2 to 4 integers.
    IVec(u8),
}

/// A statement.
#[derive(Debug, PartialEq)]
pub(in crate::renderers) enum Stmt {
    Let(Type, String, Expr),
    Set(String, Expr),
    /// `name += value`
    Add(String, Expr),
    If(Expr, Vec<Stmt>, Vec<Stmt>),
    /// A variable that counts from the first value to below the second.
    For(String, Expr, Expr, Vec<Stmt>),
    Break,
    Return(Expr),
}

/// An expression.
#[derive(Debug, PartialEq)]
pub(in crate::renderers) enum Expr {
    /// As written; an integer has no point.
    Number(String),
    Name(String),
    Call(String, Vec<Expr>),
    /// Components of a vector.
    Member(Box<Expr>, String),
    /// A component of a vector by its number.
    Index(Box<Expr>, Box<Expr>),
    Unary(&'static str, Box<Expr>),
    Binary(&'static str, Box<Expr>, Box<Expr>),
    /// `condition ? a : b`; both may be evaluated.
    Choose(Box<Expr>, Box<Expr>, Box<Expr>),
}

impl Type {
    const ALL: [(&'static str, Self); 9] = [
        ("bool", Self::Bool),
        ("int", Self::Int),
        ("float", Self::Float),
        ("vec2", Self::Vec(2)),
        ("vec3", Self::Vec(3)),
        ("vec4", Self::Vec(4)),
        ("ivec2", Self::IVec(2)),
        ("ivec3", Self::IVec(3)),
        ("ivec4", Self::IVec(4)),
    ];

    /// The type called `word` in GLSL.
    pub fn named(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|(name, _)| *name == word).map(|(_, kind)| kind)
    }

    /// Its name in GLSL.
    pub fn name(self) -> &'static str {
        Self::ALL.into_iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }
}

/// How tightly a binary operator binds.
pub(in crate::renderers) fn strength(operator: &str) -> u8 {
    match operator {
        "||" => 1,
        "&&" => 2,
        "==" | "!=" => 3,
        "<" | ">" | "<=" | ">=" => 4,
        "+" | "-" => 5,
        _ => 6,
    }
}

const OPERATORS: [&str; 12] = ["||", "&&", "==", "!=", "<=", ">=", "<", ">", "+", "-", "*", "/"];

impl Program {
    /// Reads a program.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the line: the text belongs to us, so this is a mistake of ours.
    pub fn parse(text: &str) -> Result<Self> {
        let mut reader = Reader { tokens: tokens(text)?, at: 0 };
        let mut items = Vec::new();
        while let Some(comment) = reader.comment() {
            items.push(reader.item(comment)?);
        }
        Ok(Self { items })
    }
}

impl Stmt {
    /// Whether it, or a statement inside it, changes the variable `name`.
    pub fn changes(&self, name: &str) -> bool {
        match self {
            Self::Set(other, _) | Self::Add(other, _) => other == name,
            Self::If(_, yes, no) => yes.iter().chain(no).any(|stmt| stmt.changes(name)),
            Self::For(_, _, _, body) => body.iter().any(|stmt| stmt.changes(name)),
            _ => false,
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Word(String),
    Number(String),
    Sign(&'static str),
    /// A line that is only a comment.
    Comment(String),
}

const SIGNS: [&str; 12] = ["+=", "++", "(", ")", "{", "}", "[", "]", ",", ";", "?", ":"];
const LONE: [&str; 3] = [".", "=", "!"];

/// Tokens with their lines.
fn tokens(text: &str) -> Result<Vec<(Token, usize)>> {
    let mut found = Vec::new();
    for (line, text) in text.lines().enumerate() {
        let mut rest = text.trim();
        if let Some(comment) = rest.strip_prefix("//") {
            found.push((Token::Comment(comment.trim().into()), line + 1));
            continue;
        }
        while !rest.is_empty() {
            let length = |more: &dyn Fn(char) -> bool| rest.find(|c| !more(c)).unwrap_or(rest.len());
            let (token, used) = if rest.starts_with("//") {
                break;
            } else if rest.starts_with(|c: char| c.is_ascii_alphabetic()) {
                let used = length(&|c| c.is_ascii_alphanumeric() || c == '_');
                (Token::Word(rest[..used].into()), used)
            } else if rest.starts_with(|c: char| c.is_ascii_digit()) {
                let mut used = length(&|c| c.is_ascii_digit() || c == '.');
                if rest[used..].starts_with("e-") {
                    used += 2 + rest[used + 2..].find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len() - used - 2);
                }
                (Token::Number(rest[..used].into()), used)
            } else {
                let signs = || SIGNS[..2].iter().chain(&OPERATORS).chain(&SIGNS[2..]).chain(&LONE);
                let sign = signs().find(|sign| rest.starts_with(**sign));
                let sign = sign.ok_or_else(|| wrong(line + 1, format!("unknown sign at {rest:?}")))?;
                (Token::Sign(sign), sign.len())
            };
            found.push((token, line + 1));
            rest = rest[used..].trim_start();
        }
    }
    Ok(found)
}

fn wrong(line: usize, problem: String) -> Error {
    Error::parameter("shader", format!("line {line}: {problem}"))
}

struct Reader {
    tokens: Vec<(Token, usize)>,
    at: usize,
}

impl Reader {
    /// The comment before the next definition; `None` at the end.
    fn comment(&mut self) -> Option<Vec<String>> {
        let mut lines = Vec::new();
        while let Some((Token::Comment(line), _)) = self.tokens.get(self.at) {
            lines.push(line.clone());
            self.at += 1;
        }
        (self.at < self.tokens.len()).then_some(lines)
    }

    fn next(&mut self) -> Result<Token> {
        while let Some((Token::Comment(_), _)) = self.tokens.get(self.at) {
            self.at += 1;
        }
        let (token, _) = self.tokens.get(self.at).ok_or_else(|| wrong(0, "the text ends too early".into()))?;
        self.at += 1;
        Ok(token.clone())
    }

    fn peek(&self) -> Option<&Token> {
        self.tokens[self.at..].iter().map(|(token, _)| token).find(|token| !matches!(token, Token::Comment(_)))
    }

    fn problem(&self, expected: &str) -> Error {
        let (token, line) = &self.tokens[self.at.saturating_sub(1).min(self.tokens.len() - 1)];
        wrong(*line, format!("found {token:?}, expected {expected}"))
    }

    fn takes(&mut self, sign: &str) -> bool {
        let found = matches!(self.peek(), Some(Token::Sign(found)) if *found == sign);
        if found {
            let _ = self.next();
        }
        found
    }

    fn sign(&mut self, sign: &str) -> Result<()> {
        if self.takes(sign) { Ok(()) } else { Err(self.problem(sign)) }
    }

    fn word(&mut self) -> Result<String> {
        match self.next()? {
            Token::Word(word) => Ok(word),
            _ => Err(self.problem("a word")),
        }
    }

    fn kind(&mut self) -> Result<Type> {
        let word = self.word()?;
        Type::named(&word).ok_or_else(|| self.problem("a type"))
    }

    fn item(&mut self, comment: Vec<String>) -> Result<Item> {
        if self.peek() == Some(&Token::Word("const".into())) {
            self.word()?;
            let (kind, name) = (self.kind()?, self.word()?);
            self.sign("=")?;
            let value = self.expr(0)?;
            self.sign(";")?;
            return Ok(Item { comment, name, definition: Definition::Constant(kind, value) });
        }
        let (result, name) = (self.kind()?, self.word()?);
        self.sign("(")?;
        let mut params = Vec::new();
        while !self.takes(")") {
            params.push((self.kind()?, self.word()?));
            self.takes(",");
        }
        let body = self.block()?;
        Ok(Item { comment, name, definition: Definition::Function { result, params, body } })
    }

    fn block(&mut self) -> Result<Vec<Stmt>> {
        self.sign("{")?;
        let mut body = Vec::new();
        while !self.takes("}") {
            body.push(self.stmt()?);
        }
        Ok(body)
    }

    fn stmt(&mut self) -> Result<Stmt> {
        let word = self.word()?;
        let stmt = match &*word {
            "if" => {
                self.sign("(")?;
                let condition = self.expr(0)?;
                self.sign(")")?;
                let yes = self.block()?;
                let otherwise = self.peek() == Some(&Token::Word("else".into()));
                let no = if otherwise { self.word().and_then(|_| self.block())? } else { Vec::new() };
                return Ok(Stmt::If(condition, yes, no));
            }
            "for" => return self.counted(),
            "return" => Stmt::Return(self.expr(0)?),
            "break" => Stmt::Break,
            _ => match Type::named(&word) {
                Some(kind) => {
                    let name = self.word()?;
                    self.sign("=")?;
                    Stmt::Let(kind, name, self.expr(0)?)
                }
                None if self.takes("+=") => Stmt::Add(word, self.expr(0)?),
                None => {
                    self.sign("=")?;
                    Stmt::Set(word, self.expr(0)?)
                }
            },
        };
        self.sign(";")?;
        Ok(stmt)
    }

    /// `for (int i = a; i < b; i++) { }`
    fn counted(&mut self) -> Result<Stmt> {
        self.sign("(")?;
        self.kind()?;
        let name = self.word()?;
        self.sign("=")?;
        let first = self.expr(0)?;
        self.sign(";")?;
        self.word()?;
        self.sign("<")?;
        let end = self.expr(0)?;
        self.sign(";")?;
        self.word()?;
        self.sign("++")?;
        self.sign(")")?;
        Ok(Stmt::For(name, first, end, self.block()?))
    }

    /// An expression whose operators bind more tightly than `least`.
    fn expr(&mut self, least: u8) -> Result<Expr> {
        let mut left = self.operand()?;
        loop {
            let Some(&Token::Sign(sign)) = self.peek() else { return Ok(left) };
            let operator = OPERATORS.iter().copied().find(|operator| *operator == sign);
            left = match operator {
                Some(operator) if strength(operator) > least => {
                    self.next()?;
                    Expr::Binary(operator, Box::new(left), Box::new(self.expr(strength(operator))?))
                }
                None if sign == "?" && least == 0 => {
                    self.next()?;
                    let yes = self.expr(0)?;
                    self.sign(":")?;
                    return Ok(Expr::Choose(Box::new(left), Box::new(yes), Box::new(self.expr(0)?)));
                }
                _ => return Ok(left),
            };
        }
    }

    fn operand(&mut self) -> Result<Expr> {
        let mut found = match self.next()? {
            Token::Number(number) => Expr::Number(number),
            Token::Sign("(") => {
                let inner = self.expr(0)?;
                self.sign(")")?;
                inner
            }
            Token::Sign(sign @ ("-" | "!")) => return Ok(Expr::Unary(sign, Box::new(self.operand()?))),
            Token::Word(name) if self.takes("(") => {
                let mut arguments = Vec::new();
                while !self.takes(")") {
                    arguments.push(self.expr(0)?);
                    self.takes(",");
                }
                Expr::Call(name, arguments)
            }
            Token::Word(name) => Expr::Name(name),
            _ => return Err(self.problem("an expression")),
        };
        loop {
            if self.takes(".") {
                found = Expr::Member(Box::new(found), self.word()?);
            } else if self.takes("[") {
                found = Expr::Index(Box::new(found), Box::new(self.expr(0)?));
                self.sign("]")?;
            } else {
                return Ok(found);
            }
        }
    }
}
