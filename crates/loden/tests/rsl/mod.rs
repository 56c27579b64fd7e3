//! A small reader of the RenderMan Shading Language: the part of it that exports use.
//!
//! Names are resolved against the language (The RenderMan Interface 3.2, sections 11 to 15) before anything runs: keywords, global
//! variables of surface shaders, built-in functions with the number of their arguments, and what the text defines before it is used.

pub mod machine;
pub mod parse;

use std::collections::HashMap;

use parse::{Expr, Function, Shader, Stmt};

pub const KEYWORDS: &str = "break color continue displacement else extern float for if illuminance illuminate imager light matrix normal \
    output point return solar string surface transformation uniform varying vector void volume while";

/// What a surface shader sees; the second list only inside `illuminance`.
const GLOBALS: &str = "Cs Os P dPdu dPdv N Ng u v du dv s t E I ncomps time dtime Ci Oi PI";
const LIT: &str = "L Cl Ol";

/// Functions with their least and greatest number of arguments.
const BUILT_IN: &[(&str, usize, usize)] = &[
    ("radians", 1, 1),
    ("degrees", 1, 1),
    ("sin", 1, 1),
    ("asin", 1, 1),
    ("cos", 1, 1),
    ("acos", 1, 1),
    ("tan", 1, 1),
    ("atan", 1, 2),
    ("pow", 2, 2),
    ("exp", 1, 1),
    ("sqrt", 1, 1),
    ("inversesqrt", 1, 1),
    ("log", 1, 2),
    ("mod", 2, 2),
    ("abs", 1, 1),
    ("sign", 1, 1),
    ("min", 2, 9),
    ("max", 2, 9),
    ("clamp", 3, 3),
    ("mix", 3, 3),
    ("floor", 1, 1),
    ("ceil", 1, 1),
    ("round", 1, 1),
    ("step", 2, 2),
    ("Du", 1, 1),
    ("Dv", 1, 1),
    ("xcomp", 1, 1),
    ("ycomp", 1, 1),
    ("zcomp", 1, 1),
    ("length", 1, 1),
    ("normalize", 1, 1),
    ("distance", 2, 2),
    ("faceforward", 2, 3),
    ("transform", 2, 3),
    ("vtransform", 2, 3),
    ("ntransform", 2, 3),
    ("comp", 2, 3),
    ("concat", 2, 9),
    ("texture", 1, 12),
];

fn listed(list: &str, name: &str) -> bool {
    list.split_whitespace().any(|word| word == name)
}

/// Checks every name of a text.
///
/// # Panics
/// With the name that is not known, or is taken.
pub fn resolve(shader: &Shader) {
    let mut functions = HashMap::new();
    for function in &shader.functions {
        let mut scope = Scope { functions: &functions, names: Vec::new(), in_shader: false, lit: false };
        for (_, name) in &function.params {
            scope.declare(name);
        }
        let (last, before) = function.body.split_last().unwrap();
        assert!(matches!(last, Stmt::Return(_)), "{}: the last statement is no return", function.name);
        assert!(!before.iter().any(returns), "{}: a function returns once", function.name);
        scope.block(&function.body);
        assert!(!is_taken(&function.name) && !functions.contains_key(&*function.name), "{}", function.name);
        functions.insert(&*function.name, function);
    }
    let mut scope = Scope { functions: &functions, names: Vec::new(), in_shader: true, lit: false };
    for (_, name, default) in &shader.params {
        scope.expr(default);
        scope.declare(name);
    }
    scope.block(&shader.body);
}

fn is_taken(name: &str) -> bool {
    listed(KEYWORDS, name)
        || listed(GLOBALS, name)
        || listed(LIT, name)
        || BUILT_IN.iter().any(|(known, ..)| *known == name)
}

fn returns(stmt: &Stmt) -> bool {
    match stmt {
        Stmt::Return(_) => true,
        Stmt::If(_, yes, no) => yes.iter().chain(no).any(returns),
        Stmt::For(_, _, _, body) | Stmt::Illuminance(_, body) => body.iter().any(returns),
        _ => false,
    }
}

struct Scope<'a> {
    functions: &'a HashMap<&'a str, &'a Function>,
    /// Variables, each with the depth of its block.
    names: Vec<(String, usize)>,
    in_shader: bool,
    lit: bool,
}

impl Scope<'_> {
    fn declare(&mut self, name: &str) {
        self.declare_at(name, 0);
    }

    fn declare_at(&mut self, name: &str, depth: usize) {
        assert!(!is_taken(name), "{name} is a word of the language");
        let again = self.names.iter().any(|(other, at)| other == name && *at == depth);
        assert!(!again, "{name} is declared twice");
        self.names.push((name.into(), depth));
    }

    fn block(&mut self, body: &[Stmt]) {
        self.block_at(body, 1);
    }

    fn block_at(&mut self, body: &[Stmt], depth: usize) {
        let before = self.names.len();
        for stmt in body {
            self.stmt(stmt, depth);
        }
        self.names.truncate(before);
    }

    fn stmt(&mut self, stmt: &Stmt, depth: usize) {
        match stmt {
            Stmt::Declare(_, name, value) => {
                value.iter().for_each(|value| self.expr(value));
                self.declare_at(name, depth);
            }
            Stmt::Assign(name, value) => {
                self.expr(value);
                let ours = self.names.iter().any(|(other, _)| other == name);
                assert!(ours || self.in_shader && ["Ci", "Oi"].contains(&&**name), "{name} cannot be assigned");
            }
            Stmt::If(condition, yes, no) => {
                self.expr(condition);
                self.block_at(yes, depth + 1);
                self.block_at(no, depth + 1);
            }
            Stmt::For(first, condition, next, body) => {
                self.stmt(first, depth);
                self.expr(condition);
                self.stmt(next, depth);
                self.block_at(body, depth + 1);
            }
            Stmt::Illuminance(arguments, body) => {
                assert!(self.in_shader && [1, 3].contains(&arguments.len()));
                arguments.iter().for_each(|argument| self.expr(argument));
                self.lit = true;
                self.block_at(body, depth + 1);
                self.lit = false;
            }
            Stmt::Return(value) => self.expr(value),
            Stmt::Break => {}
        }
    }

    fn expr(&self, expr: &Expr) {
        match expr {
            Expr::Number(_) | Expr::Text(_) => {}
            Expr::Name(name) => {
                // a function sees variables of the renderer only by extern
                let global = self.in_shader && (listed(GLOBALS, name) || self.lit && listed(LIT, name)) || name == "PI";
                assert!(global || self.names.iter().any(|(other, _)| other == name), "{name} is unknown");
            }
            Expr::Call(name, arguments) => {
                arguments.iter().for_each(|argument| self.expr(argument));
                let count = arguments.len();
                let known =
                    BUILT_IN.iter().any(|(known, least, most)| known == name && (*least..=*most).contains(&count));
                let ours = self.functions.get(&**name).is_some_and(|function| function.params.len() == count);
                assert!(known || ours, "{name} of {count} arguments is unknown");
            }
            Expr::Make(_, _, parts) => parts.iter().for_each(|part| self.expr(part)),
            Expr::Cast(_, of) | Expr::Unary(_, of) => self.expr(of),
            Expr::Channel(file, channel) => [file, channel].iter().for_each(|part| self.expr(part)),
            Expr::Binary(_, left, right) => [left, right].iter().for_each(|part| self.expr(part)),
            Expr::Choose(parts) => parts.iter().for_each(|part| self.expr(part)),
        }
    }
}
