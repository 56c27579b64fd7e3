//! Requests with their arguments, and parameter lists.

use std::collections::HashMap;

use glam::{Mat4, Vec2, Vec3};

use super::lexer::{Lexer, Token};

/// What follows a request's name.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Argument {
    Number(f32),
    Text(String),
    Numbers(Vec<f32>),
    Texts(Vec<String>),
}

/// A request; all arguments up to the next request's name.
#[derive(Debug, Clone)]
pub(super) struct Request {
    pub name: String,
    pub line: usize,
    pub arguments: Vec<Argument>,
}

/// What is wrong with a request, without its place.
pub(super) type Checked<T> = Result<T, String>;

/// Requests of one file.
pub(super) struct Requests {
    lexer: Lexer,
    /// The name that ended the request before.
    waiting: Option<(String, usize)>,
}

impl Requests {
    pub(super) fn new(bytes: Vec<u8>) -> Self {
        Self { lexer: Lexer::new(bytes), waiting: None }
    }

    pub(super) fn line(&self) -> usize {
        self.lexer.line()
    }

    /// The next request; none at the end.
    pub(super) fn next(&mut self) -> Checked<Option<Request>> {
        let (name, line) = match self.waiting.take() {
            Some(waiting) => waiting,
            None => match self.lexer.next()? {
                Some(Token::Request(name)) => (name, self.lexer.line()),
                Some(other) => return Err(format!("found {other:?}, expected a request")),
                None => return Ok(None),
            },
        };
        let mut arguments = Vec::new();
        loop {
            match self.lexer.next()? {
                Some(Token::Number(number)) => arguments.push(Argument::Number(number)),
                Some(Token::Text(text)) => arguments.push(Argument::Text(text)),
                Some(Token::Open) => arguments.push(self.array()?),
                Some(Token::Close) => return Err("found ] without [".into()),
                Some(Token::Request(next)) => {
                    self.waiting = Some((next, self.lexer.line()));
                    return Ok(Some(Request { name, line, arguments }));
                }
                None => return Ok(Some(Request { name, line, arguments })),
            }
        }
    }

    fn array(&mut self) -> Checked<Argument> {
        let (mut numbers, mut texts) = (Vec::new(), Vec::new());
        loop {
            match self.lexer.next()? {
                Some(Token::Number(number)) => numbers.push(number),
                Some(Token::Text(text)) => texts.push(text),
                Some(Token::Close) if texts.is_empty() => return Ok(Argument::Numbers(numbers)),
                Some(Token::Close) if numbers.is_empty() => return Ok(Argument::Texts(texts)),
                Some(Token::Close) => return Err("an array holds numbers and strings".into()),
                Some(other) => return Err(format!("found {other:?} in an array")),
                None => return Err("an array has no end".into()),
            }
        }
    }
}

impl Request {
    /// `count` numbers at the beginning, one by one or as an array, and what follows them.
    pub(super) fn numbers(&self, count: usize) -> Checked<(Vec<f32>, &[Argument])> {
        let expected = || format!("expected {count} numbers");
        if let Some(Argument::Numbers(list)) = self.arguments.first() {
            return if list.len() == count { Ok((list.clone(), &self.arguments[1..])) } else { Err(expected()) };
        }
        let number = |argument: &Argument| match argument {
            Argument::Number(number) => Some(*number),
            _ => None,
        };
        let list: Vec<f32> = self.arguments.iter().take(count).map_while(number).collect();
        if list.len() == count { Ok((list, &self.arguments[count..])) } else { Err(expected()) }
    }

    /// A transform of 16 numbers.
    pub(super) fn matrix(&self) -> Checked<Mat4> {
        let (numbers, _) = self.numbers(16)?;
        // rows for row vectors are columns for column vectors
        Ok(Mat4::from_cols_slice(&numbers))
    }

    /// The argument at a place as text.
    pub(super) fn text(&self, place: usize) -> Checked<&str> {
        match self.arguments.get(place) {
            Some(Argument::Text(text)) => Ok(text),
            Some(Argument::Texts(list)) if list.len() == 1 => Ok(&list[0]),
            found => Err(format!("argument {}: expected a string, found {found:?}", place + 1)),
        }
    }

    /// A handle, which may be a number or a name.
    pub(super) fn handle(&self, place: usize) -> Checked<String> {
        match self.arguments.get(place) {
            Some(Argument::Number(number)) => Ok(number.to_string()),
            _ => self.text(place).map(str::to_owned),
        }
    }

    /// The argument at a place as a list of whole numbers that are not negative.
    pub(super) fn integers(&self, place: usize) -> Checked<Vec<u32>> {
        let whole = |&v: &f32| {
            (v >= 0.0 && v.fract() == 0.0 && v < 2e9)
                .then_some(v as u32)
                .ok_or_else(|| format!("argument {}: found {v}, expected whole numbers", place + 1))
        };
        match self.arguments.get(place) {
            Some(Argument::Numbers(list)) => list.iter().map(whole).collect(),
            Some(Argument::Number(number)) => Ok(vec![whole(number)?]),
            found => Err(format!("argument {}: expected an array of numbers, found {found:?}", place + 1)),
        }
    }

    /// The parameter list from a place on.
    pub(super) fn parameters(&self, place: usize, declared: &Declarations) -> Checked<Parameters> {
        declared.list(self.arguments.get(place..).unwrap_or(&[]))
    }
}

/// How many values a parameter has on a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Class {
    Constant,
    Uniform,
    Varying,
    Vertex,
    FaceVarying,
}

/// What is known of parameters by their names.
pub(super) struct Declarations(HashMap<String, Class>);

/// The parameters that the interface declares itself and whose class matters here.
const STANDARD: &[(&str, Class)] = &[
    ("P", Class::Vertex),
    ("Pw", Class::Vertex),
    ("Pz", Class::Vertex),
    ("N", Class::Varying),
    ("Np", Class::Uniform),
    ("Cs", Class::Varying),
    ("Os", Class::Varying),
    ("s", Class::Varying),
    ("t", Class::Varying),
    ("st", Class::Varying),
];

impl Default for Declarations {
    fn default() -> Self {
        Self(STANDARD.iter().map(|(name, class)| ((*name).into(), *class)).collect())
    }
}

impl Declarations {
    /// Declares a parameter: "uniform float", "facevarying color".
    pub(super) fn declare(&mut self, name: &str, declaration: &str) {
        self.0.insert(name.into(), class(declaration.split_whitespace()));
    }

    fn list(&self, arguments: &[Argument]) -> Checked<Parameters> {
        let mut list = Vec::new();
        for pair in arguments.chunks(2) {
            let [Argument::Text(declared), value] = pair else {
                return Err(format!("found {pair:?}, expected a parameter's name and its value"));
            };
            // the name is last; before it may stand its declaration
            let name = declared.split_whitespace().last().unwrap_or_default().to_owned();
            let class = match declared.split_whitespace().count() {
                0 | 1 => self.0.get(&name).copied().unwrap_or(Class::Uniform),
                _ => class(declared.split_whitespace()),
            };
            let (numbers, texts) = match value {
                Argument::Number(number) => (vec![*number], Vec::new()),
                Argument::Numbers(list) => (list.clone(), Vec::new()),
                Argument::Text(text) => (Vec::new(), vec![text.clone()]),
                Argument::Texts(list) => (Vec::new(), list.clone()),
            };
            list.push(Parameter { name, class, numbers, texts });
        }
        Ok(Parameters(list))
    }
}

fn class<'a>(mut words: impl Iterator<Item = &'a str>) -> Class {
    match words.next() {
        Some("constant") => Class::Constant,
        Some("varying") => Class::Varying,
        Some("vertex") => Class::Vertex,
        Some("facevarying") => Class::FaceVarying,
        _ => Class::Uniform,
    }
}

/// A parameter with its values.
#[derive(Debug, Clone)]
pub(super) struct Parameter {
    pub name: String,
    pub class: Class,
    pub numbers: Vec<f32>,
    pub texts: Vec<String>,
}

/// A parameter list.
#[derive(Debug, Clone, Default)]
pub(super) struct Parameters(pub Vec<Parameter>);

impl Parameters {
    pub(super) fn get(&self, name: &str) -> Option<&Parameter> {
        self.0.iter().find(|p| p.name == name)
    }

    pub(super) fn number(&self, name: &str, default: f32) -> f32 {
        self.get(name).and_then(|p| p.numbers.first()).copied().unwrap_or(default)
    }

    /// Three numbers.
    pub(super) fn triple(&self, name: &str, default: Vec3) -> Vec3 {
        self.get(name).and_then(|p| p.numbers.first_chunk()).map_or(default, |v| Vec3::from(*v))
    }

    pub(super) fn text(&self, name: &str) -> Option<&str> {
        self.get(name).and_then(|p| p.texts.first()).map(String::as_str)
    }

    /// Points: P, or Pw with its last coordinate divided out.
    pub(super) fn points(&self) -> Checked<Vec<Vec3>> {
        if let Some(p) = self.get("P") {
            return triples(p);
        }
        let Some(p) = self.get("Pw") else { return Err("it has no P".into()) };
        if !p.numbers.len().is_multiple_of(4) {
            return Err(format!("Pw has {} numbers, expected four to a point", p.numbers.len()));
        }
        Ok(p.numbers.chunks_exact(4).map(|p| Vec3::new(p[0], p[1], p[2]) / p[3]).collect())
    }

    /// Normals with their class.
    pub(super) fn normals(&self) -> Checked<Option<(Vec<Vec3>, Class)>> {
        self.get("N").map(|p| Ok((triples(p)?, p.class))).transpose()
    }

    /// Texture coordinates with their class, t running down: st, or s and t.
    pub(super) fn texture(&self) -> Option<(Vec<Vec2>, Class)> {
        if let Some(st) = self.get("st") {
            return Some((st.numbers.chunks_exact(2).map(Vec2::from_slice).collect(), st.class));
        }
        let (s, t) = (self.get("s")?, self.get("t")?);
        Some((s.numbers.iter().zip(&t.numbers).map(|(&s, &t)| Vec2::new(s, t)).collect(), s.class))
    }
}

fn triples(p: &Parameter) -> Checked<Vec<Vec3>> {
    if !p.numbers.len().is_multiple_of(3) {
        return Err(format!("{} has {} numbers, expected three to a point", p.name, p.numbers.len()));
    }
    Ok(p.numbers.chunks_exact(3).map(Vec3::from_slice).collect())
}
