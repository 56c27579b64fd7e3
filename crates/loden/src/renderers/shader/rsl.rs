//! Prints programs in the RenderMan Shading Language.
//!
//! # Model
//! The language has one type of number and triples. Whole numbers are floats whose quotients are rounded down, vectors of two or three
//! numbers are `vector`, and those of four are the first row of a `matrix`, the only larger value that functions return. Operators of
//! matrices mean something else, so sums and products of four numbers are calls. A function sees nothing of its shader: the names of
//! the textures are its first arguments.

use std::collections::HashMap;

use super::lang::{Definition, Expr, Item, Program, Stmt, Type, strength};
use super::print::{commented, indented, is_constant, prefixed};

/// Words that a variable must not have: keywords, and what surface shaders see of the renderer.
const TAKEN: [&str; 48] = [
    "E",
    "Ci",
    "Cl",
    "Cs",
    "I",
    "L",
    "N",
    "Ng",
    "Oi",
    "Ol",
    "Os",
    "P",
    "PI",
    "area",
    "axis",
    "break",
    "centre",
    "color",
    "continue",
    "depth",
    "displacement",
    "du",
    "dv",
    "extern",
    "float",
    "from",
    "imager",
    "indices",
    "light",
    "map",
    "matrix",
    "normal",
    "numbers",
    "output",
    "point",
    "s",
    "step",
    "string",
    "surface",
    "t",
    "to",
    "transformation",
    "u",
    "uniform",
    "v",
    "varying",
    "vector",
    "volume",
];

/// The textures, as parameters and arguments of all functions.
const PARAMS: &str = "uniform string numbers, indices, directions";
const ARGUMENTS: &str = "numbers, indices, directions";

/// Functions that a head defines, with what they return.
const READ: [&str; 3] = ["number", "byte", "exact"];

/// The program in the RenderMan Shading Language.
pub(super) fn print(program: &Program) -> String {
    let results = program.items.iter().filter_map(|item| match &item.definition {
        Definition::Function { result, .. } => Some((&*item.name, *result)),
        Definition::Constant(..) => None,
    });
    let constants = program.items.iter().filter_map(|item| match &item.definition {
        Definition::Constant(kind, _) => Some((item.name.clone(), *kind)),
        Definition::Function { .. } => None,
    });
    let results = results.chain(READ.map(|name| (name, Type::Vec(4)))).collect();
    let mut printer = Printer { results, kinds: constants.collect() };
    let items = program.items.iter().map(|item| printer.item(item));
    items.collect::<Vec<_>>().join("\n")
}

struct Printer<'p> {
    /// What functions return.
    results: HashMap<&'p str, Type>,
    /// Constants, and the variables of the function so far.
    kinds: HashMap<String, Type>,
}

impl Printer<'_> {
    fn item(&mut self, item: &Item) -> String {
        let name = prefixed(&item.name);
        let comment = commented(&item.comment, ["/* ", " */"]);
        comment
            + &match &item.definition {
                Definition::Constant(_, value) => format!("#define {name} ({})\n", self.expr(value)),
                Definition::Function { result, params, body } => {
                    self.kinds.retain(|name, _| is_constant(name));
                    self.kinds.extend(params.iter().map(|(kind, name)| (name.clone(), *kind)));
                    let params: String =
                        params.iter().map(|(kind, name)| format!("; {} {}", word(*kind), local(name))).collect();
                    format!("{} {name}({PARAMS}{params}) {{\n{}}}\n", word(*result), self.body(body, 1))
                }
            }
    }

    fn body(&mut self, body: &[Stmt], depth: usize) -> String {
        body.iter().map(|stmt| self.stmt(stmt, depth)).collect()
    }

    fn stmt(&mut self, stmt: &Stmt, depth: usize) -> String {
        let line = |text: String| indented(depth, &text);
        match stmt {
            Stmt::Let(kind, name, value) => {
                let text = line(format!("{} {} = {};", word(*kind), local(name), self.expr(value)));
                self.kinds.insert(name.clone(), *kind);
                text
            }
            Stmt::Set(name, value) => line(format!("{} = {};", local(name), self.expr(value))),
            Stmt::Add(name, value) => {
                let sum = Expr::Name(name.clone());
                line(format!("{} = {};", local(name), self.binary("+", &sum, value)))
            }
            Stmt::Break => line("break;".into()),
            Stmt::Return(value) => line(format!("return {};", self.expr(value))),
            Stmt::If(condition, yes, no) => {
                let mut text = line(format!("if ({}) {{", self.expr(condition))) + &self.body(yes, depth + 1);
                if !no.is_empty() {
                    text += &(line("} else {".into()) + &self.body(no, depth + 1));
                }
                text + &line("}".into())
            }
            Stmt::For(name, first, end, body) => {
                self.kinds.insert(name.clone(), Type::Int);
                let (name, first, end) = (local(name), self.expr(first), self.expr(end));
                let head = line(format!("float {name};"))
                    + &line(format!("for ({name} = {first}; {name} < {end}; {name} += 1) {{"));
                head + &self.body(body, depth + 1) + &line("}".into())
            }
        }
    }

    fn expr(&self, expr: &Expr) -> String {
        match expr {
            Expr::Number(number) => number.clone(),
            Expr::Name(name) if is_constant(name) => prefixed(name),
            Expr::Name(name) => local(name),
            Expr::Call(name, arguments) => self.call(name, arguments),
            Expr::Member(of, names) => match (self.kind(of), &**names) {
                (Type::Vec(4), "xyz") => format!("loden_xyz({})", self.expr(of)),
                (kind, name) => self.component(kind, of, &["x", "y", "z", "w"].map(|other| other == name)),
            },
            Expr::Index(of, at) if self.kind(of).is_four() => format!("comp({}, 0, {})", self.expr(of), self.expr(at)),
            Expr::Index(of, at) => format!("loden_at({}, {})", self.expr(of), self.expr(at)),
            Expr::Unary(sign, of) => format!("{sign}{}", self.operand(of)),
            Expr::Binary(sign, left, right) => self.binary(sign, left, right),
            Expr::Choose(condition, yes, no) => {
                let [condition, yes, no] = [condition, yes, no].map(|expr| self.expr(expr));
                format!("(({condition}) ? {yes} : {no})")
            }
        }
    }

    /// The component of a vector that `is` true.
    fn component(&self, kind: Type, of: &Expr, is: &[bool; 4]) -> String {
        let place = is.iter().position(|&is| is).unwrap_or(0);
        let of = self.expr(of);
        if kind.is_four() {
            format!("comp({of}, 0, {place})")
        } else {
            format!("{}comp({of})", ["x", "y", "z", "w"][place])
        }
    }

    fn call(&self, name: &str, arguments: &[Expr]) -> String {
        let list = arguments.iter().map(|argument| self.expr(argument)).collect::<Vec<_>>();
        let first = arguments.first().map_or(Type::Float, |first| self.kind(first));
        let all = list.join(", ");
        match (name, Type::named(name)) {
            (_, Some(Type::Int)) if first == Type::Float => format!("loden_int({all})"),
            (_, Some(Type::Int | Type::Float | Type::Bool)) => list.concat(),
            (_, Some(Type::Vec(4) | Type::IVec(4))) if list.len() == 4 => format!("loden_four({all})"),
            (_, Some(Type::Vec(4) | Type::IVec(4))) => format!("loden_four({all}, {all}, {all}, {all})"),
            (_, Some(Type::Vec(2) | Type::IVec(2))) if list.len() == 2 => format!("vector ({all}, 0)"),
            (_, Some(Type::Vec(3) | Type::IVec(3))) if list.len() == 3 => format!("vector ({all})"),
            (_, Some(_)) => format!("loden_all({all})"),
            ("dot", _) if first.is_four() => format!("loden_dot({all})"),
            ("dot" | "cross", _) => {
                let [left, right] = [0, 1].map(|k| self.operand(&arguments[k]));
                format!("({left} {} {right})", if name == "dot" { "." } else { "^" })
            }
            ("max" | "min" | "clamp" | "mix", _) if first != Type::Float && first != Type::Int => {
                format!("loden_{name}_each({all})")
            }
            ("mix", _) => format!("loden_mix({all})"),
            _ if self.results.contains_key(name) => {
                let all = if list.is_empty() { String::new() } else { format!(", {all}") };
                format!("{}({ARGUMENTS}{all})", prefixed(name))
            }
            _ => format!("{name}({all})"),
        }
    }

    fn binary(&self, sign: &str, left: &Expr, right: &Expr) -> String {
        let (a, b) = (self.kind(left), self.kind(right));
        let call = |name: &str, a: &Expr, b: &Expr| format!("{name}({}, {})", self.expr(a), self.expr(b));
        match (sign, a, b) {
            ("/", Type::Int, Type::Int) => format!("floor({} / {})", self.side(left, 6), self.side(right, 7)),
            ("+", ..) if a.is_four() => call("loden_plus", left, right),
            ("*", ..) if a.is_four() => call("loden_times", right, left),
            ("*", ..) if b.is_four() => call("loden_times", left, right),
            ("*", Type::Vec(_), Type::Vec(_)) => call("loden_times_each", left, right),
            _ => format!("{} {sign} {}", self.side(left, strength(sign)), self.side(right, strength(sign) + 1)),
        }
    }

    /// A side of an operator, in parentheses if it binds less tightly than `least`.
    fn side(&self, side: &Expr, least: u8) -> String {
        match side {
            Expr::Binary(inner, ..) if strength(inner) < least => format!("({})", self.expr(side)),
            Expr::Unary(..) => format!("({})", self.expr(side)),
            _ => self.expr(side),
        }
    }

    /// What stands beside a sign that binds most tightly.
    fn operand(&self, expr: &Expr) -> String {
        match expr {
            Expr::Binary(..) | Expr::Unary(..) | Expr::Number(_) => format!("({})", self.expr(expr)),
            _ => self.expr(expr),
        }
    }

    fn kind(&self, expr: &Expr) -> Type {
        let of_vector = |kind: Type| if matches!(kind, Type::IVec(_)) { Type::Int } else { Type::Float };
        match expr {
            Expr::Number(number) => {
                if number.contains(['.', 'e']) {
                    Type::Float
                } else {
                    Type::Int
                }
            }
            Expr::Name(name) => self.kinds.get(name).copied().unwrap_or(Type::Float),
            Expr::Call(name, arguments) => {
                Type::named(name).or(self.results.get(&**name).copied()).unwrap_or_else(|| match &**name {
                    "dot" | "length" => Type::Float,
                    _ => arguments.first().map_or(Type::Float, |first| self.kind(first)),
                })
            }
            Expr::Member(of, names) if names.len() == 1 => of_vector(self.kind(of)),
            Expr::Member(_, names) => Type::Vec(names.len() as u8),
            Expr::Index(of, _) => of_vector(self.kind(of)),
            Expr::Unary("!", _) => Type::Bool,
            Expr::Unary(_, of) => self.kind(of),
            Expr::Binary(sign, left, right) => match (strength(sign), self.kind(left), self.kind(right)) {
                (5.., Type::Float | Type::Int, kind) => kind,
                (5.., kind, _) => kind,
                _ => Type::Bool,
            },
            Expr::Choose(_, yes, _) => self.kind(yes),
        }
    }
}

impl Type {
    fn is_four(self) -> bool {
        matches!(self, Self::Vec(4) | Self::IVec(4))
    }
}

/// The name of a type.
fn word(kind: Type) -> &'static str {
    match kind {
        Type::Bool | Type::Int | Type::Float => "float",
        Type::Vec(4) | Type::IVec(4) => "matrix",
        Type::Vec(_) | Type::IVec(_) => "vector",
    }
}

/// The name of a local variable.
fn local(name: &str) -> String {
    if TAKEN.contains(&name) { format!("{name}_") } else { name.into() }
}
