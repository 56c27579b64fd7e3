//! Requests with their arguments and parameter lists.

use std::collections::HashMap;

use glam::{Mat4, Vec2, Vec3};

use super::lexer::{Lexer, Token};

/// An argument of a request.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Argument {
    Number(f32),
    Text(String),
    Numbers(Vec<f32>),
    Texts(Vec<String>),
}

/// A request with all its arguments.
#[derive(Debug, Clone)]
pub(super) struct Request {
    pub name: String,
    pub line: usize,
    pub arguments: Vec<Argument>,
}

/// A result whose error omits the file, line and request; [`super::Reader`] adds them.
pub(super) type RibResult<T> = Result<T, String>;

/// Why a request was not executed.
#[derive(Debug)]
pub(super) enum Fault {
    /// The request is skipped with a warning.
    Skip(String),
    /// The scene is not read any further.
    Stop(String),
}

impl From<String> for Fault {
    fn from(problem: String) -> Self {
        Self::Skip(problem)
    }
}

impl From<&str> for Fault {
    fn from(problem: &str) -> Self {
        Self::Skip(problem.into())
    }
}

/// The result of executing a request.
pub(super) type Step<T> = Result<T, Fault>;

/// The requests of a file.
pub(super) struct Requests {
    lexer: Lexer,
    /// The name that ended the previous request, and its line.
    waiting: Option<(String, usize)>,
    /// Whether everything is skipped up to the next request.
    lost: bool,
}

impl Requests {
    pub(super) fn new(bytes: Vec<u8>) -> Self {
        Self { lexer: Lexer::new(bytes), waiting: None, lost: false }
    }

    pub(super) fn line(&self) -> usize {
        self.lexer.line()
    }

    /// The next request; `None` at the end of the file. After an error, what is left of the request is skipped.
    pub(super) fn next(&mut self) -> RibResult<Option<Request>> {
        let found = self.read();
        self.lost = found.is_err();
        found
    }

    fn read(&mut self) -> RibResult<Option<Request>> {
        let (name, line) = match self.waiting.take() {
            Some(waiting) => waiting,
            None => loop {
                match self.lexer.next() {
                    Ok(Some(Token::Request(name))) => break (name, self.lexer.line()),
                    Ok(None) => return Ok(None),
                    _ if self.lost => {}
                    Ok(Some(other)) => return Err(format!("found {other:?}, expected a request")),
                    Err(problem) => return Err(problem),
                }
            },
        };
        let mut arguments = Vec::new();
        loop {
            match self.lexer.next()? {
                Some(Token::Number(number)) => arguments.push(Argument::Number(number)),
                Some(Token::Text(text)) => arguments.push(Argument::Text(text)),
                Some(Token::Open) => arguments.push(self.array()?),
                Some(Token::Close) => return Err("found ] without a matching [".into()),
                Some(Token::Request(next)) => {
                    self.waiting = Some((next, self.lexer.line()));
                    return Ok(Some(Request { name, line, arguments }));
                }
                None => return Ok(Some(Request { name, line, arguments })),
            }
        }
    }

    fn array(&mut self) -> RibResult<Argument> {
        let (mut numbers, mut texts) = (Vec::new(), Vec::new());
        loop {
            match self.lexer.next()? {
                Some(Token::Number(number)) => numbers.push(number),
                Some(Token::Text(text)) => texts.push(text),
                Some(Token::Close) if texts.is_empty() => return Ok(Argument::Numbers(numbers)),
                Some(Token::Close) if numbers.is_empty() => return Ok(Argument::Texts(texts)),
                Some(Token::Close) => return Err("found numbers and strings in one array".into()),
                Some(Token::Open) => return Err("found an array in an array".into()),
                // go on with the request that follows
                Some(Token::Request(next)) => {
                    self.waiting = Some((next, self.lexer.line()));
                    return Err("an array is not closed".into());
                }
                None => return Err("an array is not closed".into()),
            }
        }
    }
}

impl Request {
    /// The first `count` numbers, given one by one or as an array, and the arguments that follow them.
    pub(super) fn numbers(&self, count: usize) -> RibResult<(Vec<f32>, &[Argument])> {
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

    /// A 4 x 4 matrix.
    pub(super) fn matrix(&self) -> RibResult<Mat4> {
        let (numbers, _) = self.numbers(16)?;
        // Rows of a matrix for row vectors are columns of one for column vectors.
        Ok(Mat4::from_cols_slice(&numbers))
    }

    /// The string at this index.
    pub(super) fn text(&self, place: usize) -> RibResult<&str> {
        match self.arguments.get(place) {
            Some(Argument::Text(text)) => Ok(text),
            Some(Argument::Texts(list)) if list.len() == 1 => Ok(&list[0]),
            found => Err(format!("argument {}: found {found:?}, expected a string", place + 1)),
        }
    }

    /// The handle at this index: a number or a name.
    pub(super) fn handle(&self, place: usize) -> RibResult<String> {
        match self.arguments.get(place) {
            Some(Argument::Number(number)) => Ok(number.to_string()),
            _ => self.text(place).map(str::to_owned),
        }
    }

    /// The array of non-negative integers at this index.
    pub(super) fn integers(&self, place: usize) -> RibResult<Vec<u32>> {
        let whole = |&v: &f32| {
            (v >= 0.0 && v.fract() == 0.0 && v < 2e9)
                .then_some(v as u32)
                .ok_or_else(|| format!("argument {}: found {v}, expected non-negative integers", place + 1))
        };
        match self.arguments.get(place) {
            Some(Argument::Numbers(list)) => list.iter().map(whole).collect(),
            Some(Argument::Number(number)) => Ok(vec![whole(number)?]),
            found => Err(format!("argument {}: found {found:?}, expected an array of numbers", place + 1)),
        }
    }

    /// The parameter list that starts at this index.
    pub(super) fn parameters(&self, place: usize, declared: &Declarations) -> RibResult<Parameters> {
        declared.list(self.arguments.get(place..).unwrap_or(&[]))
    }
}

/// Storage class of a parameter: how many values it has on a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Class {
    Constant,
    Uniform,
    Varying,
    Vertex,
    FaceVarying,
}

/// Storage classes and declarations of the declared parameters, by name.
pub(super) struct Declarations(HashMap<String, (Class, String)>);

/// Predeclared parameters whose storage class matters here.
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
        Self(STANDARD.iter().map(|(name, class)| ((*name).into(), (*class, String::new()))).collect())
    }
}

impl Declarations {
    /// Declares a parameter, such as "uniform float" or "facevarying color".
    pub(super) fn declare(&mut self, name: &str, declaration: &str) {
        self.0.insert(name.into(), (class(declaration.split_whitespace()), declaration.into()));
    }

    fn list(&self, arguments: &[Argument]) -> RibResult<Parameters> {
        let mut list = Vec::new();
        for pair in arguments.chunks(2) {
            let [Argument::Text(declared), value] = pair else {
                return Err(format!("found {pair:?}, expected a parameter name and a value"));
            };
            // The name comes last, after an optional declaration.
            let name = declared.split_whitespace().last().unwrap_or_default().to_owned();
            let class = match declared.split_whitespace().count() {
                0 | 1 => self.0.get(&name).map_or(Class::Uniform, |(class, _)| *class),
                _ => class(declared.split_whitespace()),
            };
            let (numbers, texts) = match value {
                Argument::Number(number) => (vec![*number], Vec::new()),
                Argument::Numbers(list) => (list.clone(), Vec::new()),
                Argument::Text(text) => (Vec::new(), vec![text.clone()]),
                Argument::Texts(list) => (Vec::new(), list.clone()),
            };
            let declared = match declared.split_whitespace().count() {
                0 | 1 => self.0.get(&name).map_or(String::new(), |(_, declaration)| declaration.clone()),
                _ => declared.clone(),
            };
            list.push(Parameter { name, class, declaration: declared, numbers, texts });
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

/// A parameter and its values.
#[derive(Debug, Clone)]
pub(super) struct Parameter {
    pub name: String,
    pub class: Class,
    /// The declaration, such as "uniform color"; empty if there is none.
    pub declaration: String,
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

    /// The first three numbers.
    pub(super) fn triple(&self, name: &str, default: Vec3) -> Vec3 {
        self.get(name).and_then(|p| p.numbers.first_chunk()).map_or(default, |v| Vec3::from(*v))
    }

    pub(super) fn text(&self, name: &str) -> Option<&str> {
        self.get(name).and_then(|p| p.texts.first()).map(String::as_str)
    }

    /// The first string of the first of several names that has one.
    pub(super) fn any_text(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|name| self.text(name)).filter(|text| !text.is_empty())
    }

    /// The first number of the first of several names that has one.
    pub(super) fn any_number(&self, names: &[&str]) -> Option<f32> {
        names.iter().find_map(|name| self.get(name)?.numbers.first().copied())
    }

    /// A parameter of colours, or one number for all channels, and its storage class.
    pub(super) fn colors(&self, name: &str) -> Option<(Vec<Vec3>, Class)> {
        let p = self.get(name)?;
        match p.numbers.len() {
            0 => None,
            1 => Some((vec![Vec3::splat(p.numbers[0])], p.class)),
            _ => Some((p.numbers.chunks_exact(3).map(Vec3::from_slice).collect(), p.class)),
        }
    }

    /// The points of P, or of Pw divided by its last coordinate.
    pub(super) fn points(&self) -> RibResult<Vec<Vec3>> {
        if let Some(p) = self.get("P") {
            return triples(p);
        }
        let Some(p) = self.get("Pw") else { return Err("the parameter P is missing".into()) };
        if !p.numbers.len().is_multiple_of(4) {
            return Err(format!("Pw: found {} numbers, expected 4 per point", p.numbers.len()));
        }
        Ok(p.numbers.chunks_exact(4).map(|p| Vec3::new(p[0], p[1], p[2]) / p[3]).collect())
    }

    /// The normals and their storage class.
    pub(super) fn normals(&self) -> RibResult<Option<(Vec<Vec3>, Class)>> {
        self.get("N").map(|p| Ok((triples(p)?, p.class))).transpose()
    }

    /// The texture coordinates of st, or of s and t, and their storage class; t points down.
    pub(super) fn texture(&self) -> Option<(Vec<Vec2>, Class)> {
        if let Some(st) = self.get("st") {
            return Some((st.numbers.chunks_exact(2).map(Vec2::from_slice).collect(), st.class));
        }
        let (s, t) = (self.get("s")?, self.get("t")?);
        Some((s.numbers.iter().zip(&t.numbers).map(|(&s, &t)| Vec2::new(s, t)).collect(), s.class))
    }
}

impl Parameter {
    /// Whether the declaration has this word: a type, or "reference".
    pub(super) fn is_declared(&self, word: &str) -> bool {
        self.declaration.split_whitespace().any(|w| w.split('[').next() == Some(word))
    }
}

fn triples(p: &Parameter) -> RibResult<Vec<Vec3>> {
    if !p.numbers.len().is_multiple_of(3) {
        return Err(format!("{}: found {} numbers, expected 3 per point", p.name, p.numbers.len()));
    }
    Ok(p.numbers.chunks_exact(3).map(Vec3::from_slice).collect())
}
