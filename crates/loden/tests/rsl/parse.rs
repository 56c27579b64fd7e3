//! Reads a surface shader with its functions.

use std::collections::HashMap;

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    Float,
    Vector,
    Point,
    Normal,
    Color,
    Matrix,
    Text,
}

impl Kind {
    fn named(word: &str) -> Option<Self> {
        Some(match word {
            "float" => Self::Float,
            "vector" => Self::Vector,
            "point" => Self::Point,
            "normal" => Self::Normal,
            "color" => Self::Color,
            "matrix" => Self::Matrix,
            "string" => Self::Text,
            _ => return None,
        })
    }
}

#[derive(Debug)]
pub enum Expr {
    Number(f32),
    Text(String),
    Name(String),
    Call(String, Vec<Expr>),
    /// Three or sixteen numbers, in a named space.
    Make(Kind, Option<String>, Vec<Expr>),
    Cast(Kind, Box<Expr>),
    /// `file[0]`
    Channel(Box<Expr>, Box<Expr>),
    Unary(char, Box<Expr>),
    Binary(&'static str, Box<Expr>, Box<Expr>),
    Choose(Box<[Expr; 3]>),
}

#[derive(Debug)]
pub enum Stmt {
    Declare(Kind, String, Option<Expr>),
    Assign(String, Expr),
    If(Expr, Vec<Stmt>, Vec<Stmt>),
    For(Box<Stmt>, Expr, Box<Stmt>, Vec<Stmt>),
    Illuminance(Vec<Expr>, Vec<Stmt>),
    Return(Expr),
    Break,
}

#[derive(Debug)]
pub struct Function {
    pub name: String,
    pub result: Kind,
    pub params: Vec<(Kind, String)>,
    pub body: Vec<Stmt>,
}

#[derive(Debug)]
pub struct Shader {
    pub name: String,
    pub params: Vec<(Kind, String, Expr)>,
    pub body: Vec<Stmt>,
    pub functions: Vec<Function>,
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Word(String),
    Number(f32),
    Text(String),
    Sign(&'static str),
}

const SIGNS: [&str; 32] = [
    "+=", "-=", "*=", "/=", "==", "!=", "<=", ">=", "&&", "||", "(", ")", "{", "}", "[", "]", ",", ";", "?", ":", "<",
    ">", "+", "-", "*", "/", "^", ".", "=", "!", "#", "\\",
];

/// Binary operators and how tightly they bind.
const OPERATORS: [(&str, u8); 14] = [
    ("||", 1),
    ("&&", 2),
    ("==", 3),
    ("!=", 3),
    ("<", 4),
    (">", 4),
    ("<=", 4),
    (">=", 4),
    ("+", 5),
    ("-", 5),
    ("^", 6),
    ("/", 7),
    ("*", 7),
    (".", 8),
];

fn tokens(text: &str) -> Vec<Token> {
    let (mut found, mut rest) = (Vec::new(), text.trim_start());
    while let Some(first) = rest.chars().next() {
        let length = |accept: &dyn Fn(char) -> bool| rest.find(|c| !accept(c)).unwrap_or(rest.len());
        let used = if rest.starts_with("/*") {
            rest.find("*/").expect("a comment ends") + 2
        } else if first.is_ascii_alphabetic() {
            let used = length(&|c| c.is_ascii_alphanumeric() || c == '_');
            found.push(Token::Word(rest[..used].into()));
            used
        } else if first.is_ascii_digit() {
            let mut used = length(&|c| c.is_ascii_digit() || c == '.');
            if rest[used..].starts_with("e-") {
                used += 2 + rest[used + 2..].find(|c: char| !c.is_ascii_digit()).unwrap();
            }
            found.push(Token::Number(rest[..used].parse().unwrap()));
            used
        } else if first == '"' {
            let end = rest[1..].find('"').expect("a string ends");
            found.push(Token::Text(rest[1..=end].into()));
            end + 2
        } else {
            let sign = SIGNS.into_iter().find(|sign| rest.starts_with(sign)).unwrap_or_else(|| panic!("{rest:.20}"));
            found.push(Token::Sign(sign));
            sign.len()
        };
        rest = rest[used..].trim_start();
    }
    found
}

/// The preprocessor: `#define NAME text`, a line each.
fn preprocessed(text: &str) -> Vec<Token> {
    let defines: HashMap<&str, Vec<Token>> = text
        .lines()
        .filter_map(|line| line.strip_prefix("#define ")?.split_once(' '))
        .map(|(name, value)| (name, tokens(value)))
        .collect();
    let code: String = text.lines().filter(|line| !line.starts_with('#')).map(|line| line.to_owned() + "\n").collect();
    let replaced = |token: Token| match &token {
        Token::Word(word) => defines.get(&**word).cloned().unwrap_or_else(|| vec![token]),
        _ => vec![token],
    };
    tokens(&code).into_iter().flat_map(replaced).collect()
}

/// Reads a text.
///
/// # Panics
/// If it is not of the part of the language that is known here.
pub fn parse(text: &str) -> Shader {
    let mut reader = Reader { tokens: preprocessed(text), at: 0 };
    let mut functions = Vec::new();
    loop {
        let word = reader.word();
        if word == "surface" {
            let name = reader.word();
            let params =
                reader.formals(true).into_iter().map(|(kind, name, value)| (kind, name, value.expect("a default")));
            let params = params.collect();
            let body = reader.block();
            assert_eq!(reader.at, reader.tokens.len(), "the shader is the end");
            return Shader { name, params, body, functions };
        }
        let result = Kind::named(&word).unwrap_or_else(|| panic!("{word}"));
        let name = reader.word();
        let params = reader.formals(false).into_iter().map(|(kind, name, _)| (kind, name)).collect();
        let body = reader.block();
        functions.push(Function { name, result, params, body });
    }
}

struct Reader {
    tokens: Vec<Token>,
    at: usize,
}

impl Reader {
    fn peek(&self) -> &Token {
        &self.tokens[self.at]
    }

    fn next(&mut self) -> Token {
        self.at += 1;
        self.tokens[self.at - 1].clone()
    }

    fn takes(&mut self, sign: &str) -> bool {
        let found = matches!(self.tokens.get(self.at), Some(Token::Sign(found)) if *found == sign);
        self.at += usize::from(found);
        found
    }

    fn takes_word(&mut self, word: &str) -> bool {
        let found = matches!(self.tokens.get(self.at), Some(Token::Word(found)) if found == word);
        self.at += usize::from(found);
        found
    }

    fn sign(&mut self, sign: &str) {
        assert!(self.takes(sign), "expected {sign} at {:?}", &self.tokens[self.at.saturating_sub(8)..self.at + 2]);
    }

    fn word(&mut self) -> String {
        match self.next() {
            Token::Word(word) => word,
            other => panic!("expected a word, found {other:?}"),
        }
    }

    /// `(uniform string a, b; float c = 1;)`; only shaders have defaults.
    fn formals(&mut self, defaults: bool) -> Vec<(Kind, String, Option<Expr>)> {
        self.sign("(");
        let mut found = Vec::new();
        while !self.takes(")") {
            let _ = self.takes_word("uniform") || self.takes_word("varying");
            let word = self.word();
            let kind = Kind::named(&word).unwrap_or_else(|| panic!("{word} is no type"));
            loop {
                let name = self.word();
                let value = (defaults && self.takes("=")).then(|| self.expr(0));
                found.push((kind, name, value));
                if !self.takes(",") {
                    break;
                }
            }
            let _ = self.takes(";");
        }
        found
    }

    fn block(&mut self) -> Vec<Stmt> {
        self.sign("{");
        let mut body = Vec::new();
        while !self.takes("}") {
            body.push(self.stmt());
        }
        body
    }

    fn stmt(&mut self) -> Stmt {
        let _ = self.takes_word("uniform");
        let stmt = match self.peek().clone() {
            Token::Word(word) if word == "if" => {
                self.at += 1;
                self.sign("(");
                let condition = self.expr(0);
                self.sign(")");
                let yes = self.block();
                let no = if self.takes_word("else") { self.block() } else { Vec::new() };
                return Stmt::If(condition, yes, no);
            }
            Token::Word(word) if word == "for" => {
                self.at += 1;
                self.sign("(");
                let first = self.assignment();
                self.sign(";");
                let condition = self.expr(0);
                self.sign(";");
                let next = self.assignment();
                self.sign(")");
                return Stmt::For(Box::new(first), condition, Box::new(next), self.block());
            }
            Token::Word(word) if word == "illuminance" => {
                self.at += 1;
                self.sign("(");
                let arguments = self.list(")");
                return Stmt::Illuminance(arguments, self.block());
            }
            Token::Word(word) if word == "return" => {
                self.at += 1;
                Stmt::Return(self.expr(0))
            }
            Token::Word(word) if word == "break" => {
                self.at += 1;
                Stmt::Break
            }
            Token::Word(word) if Kind::named(&word).is_some() => {
                self.at += 1;
                let name = self.word();
                let value = self.takes("=").then(|| self.expr(0));
                Stmt::Declare(Kind::named(&word).unwrap(), name, value)
            }
            _ => self.assignment(),
        };
        self.sign(";");
        stmt
    }

    fn assignment(&mut self) -> Stmt {
        let name = self.word();
        if self.takes("=") {
            return Stmt::Assign(name, self.expr(0));
        }
        self.sign("+=");
        let old = Box::new(Expr::Name(name.clone()));
        Stmt::Assign(name, Expr::Binary("+", old, Box::new(self.expr(0))))
    }

    fn list(&mut self, end: &str) -> Vec<Expr> {
        let mut found = Vec::new();
        while !self.takes(end) {
            found.push(self.expr(0));
            let _ = self.takes(",");
        }
        found
    }

    fn expr(&mut self, least: u8) -> Expr {
        let mut left = self.operand();
        loop {
            let Some(Token::Sign(sign)) = self.tokens.get(self.at) else { return left };
            let operator = OPERATORS.into_iter().find(|(operator, _)| operator == sign);
            left = match operator {
                Some((operator, strength)) if strength > least => {
                    self.at += 1;
                    Expr::Binary(operator, Box::new(left), Box::new(self.expr(strength)))
                }
                None if *sign == "?" && least == 0 => {
                    self.at += 1;
                    let yes = self.expr(0);
                    self.sign(":");
                    return Expr::Choose(Box::new([left, yes, self.expr(0)]));
                }
                _ => return left,
            };
        }
    }

    fn operand(&mut self) -> Expr {
        match self.next() {
            Token::Number(number) => Expr::Number(number),
            Token::Text(text) => Expr::Text(text),
            Token::Sign("(") => {
                let inner = self.expr(0);
                self.sign(")");
                inner
            }
            Token::Sign("-") => Expr::Unary('-', Box::new(self.operand())),
            Token::Sign("!") => Expr::Unary('!', Box::new(self.operand())),
            Token::Word(word) if Kind::named(&word).is_some() => self.of_kind(Kind::named(&word).unwrap()),
            Token::Word(word) if self.takes("(") => Expr::Call(word, self.list(")")),
            Token::Word(word) if self.takes("[") => {
                let channel = self.expr(0);
                self.sign("]");
                Expr::Channel(Box::new(Expr::Name(word)), Box::new(channel))
            }
            Token::Word(word) => Expr::Name(word),
            other => panic!("expected an expression, found {other:?}"),
        }
    }

    /// What follows the name of a type.
    fn of_kind(&mut self, kind: Kind) -> Expr {
        let space = match self.peek() {
            Token::Text(space) => Some(space.clone()),
            _ => None,
        };
        self.at += usize::from(space.is_some());
        if !self.takes("(") {
            return Expr::Cast(kind, Box::new(self.operand()));
        }
        let mut parts = self.list(")");
        match (parts.len(), kind) {
            (1, _) => Expr::Cast(kind, Box::new(parts.remove(0))),
            (3, Kind::Vector | Kind::Point | Kind::Normal | Kind::Color) | (16, Kind::Matrix) => {
                Expr::Make(kind, space, parts)
            }
            _ => panic!("{kind:?} of {} numbers", parts.len()),
        }
    }
}
