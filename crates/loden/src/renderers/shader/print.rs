//! Prints programs in the languages of the targets.

use super::lang::{Definition, Expr, Item, Program, Stmt, Type, strength};

/// A language.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::renderers) enum Language {
    /// GLSL ES 3.00.
    Glsl,
    /// WGSL.
    Wgsl,
    /// The shading language of three.js, which is JavaScript.
    Tsl,
    /// Open Shading Language. Its functions cannot see the parameters of a shader, so each has the folder of the textures as its first.
    Osl,
}

/// Functions that every language has, by their names in GLSL and WGSL; TSL has the names of GLSL but for one.
const BUILT_IN: [(&str, &str); 20] = [
    ("abs", "abs"),
    ("acos", "acos"),
    ("atan", "atan"),
    ("clamp", "clamp"),
    ("cos", "cos"),
    ("cross", "cross"),
    ("dot", "dot"),
    ("exp", "exp"),
    ("floor", "floor"),
    ("inversesqrt", "inverseSqrt"),
    ("length", "length"),
    ("log", "log"),
    ("max", "max"),
    ("min", "min"),
    ("mix", "mix"),
    ("normalize", "normalize"),
    ("pow", "pow"),
    ("sin", "sin"),
    ("sqrt", "sqrt"),
    ("tan", "tan"),
];

/// Operators and the methods that stand for them in TSL.
const METHODS: [(&str, &str); 12] = [
    ("+", "add"),
    ("-", "sub"),
    ("*", "mul"),
    ("/", "div"),
    ("<", "lessThan"),
    (">", "greaterThan"),
    ("<=", "lessThanEqual"),
    (">=", "greaterThanEqual"),
    ("==", "equal"),
    ("!=", "notEqual"),
    ("&&", "and"),
    ("||", "or"),
];

/// A name of ours, which must not meet one of the shader that includes it.
pub(super) fn prefixed(name: &str) -> String {
    if is_constant(name) { format!("LODEN_{name}") } else { format!("loden_{name}") }
}

/// Names of constants are in capitals.
pub(super) fn is_constant(name: &str) -> bool {
    !name.chars().any(|c| c.is_ascii_lowercase())
}

/// Lines as comments between signs.
pub(super) fn commented(lines: &[String], [before, after]: [&str; 2]) -> String {
    lines.iter().map(|line| format!("{before}{line}{after}\n")).collect()
}

pub(super) fn indented(depth: usize, text: &str) -> String {
    format!("{}{text}\n", "    ".repeat(depth))
}

impl Program {
    /// The program in a language.
    pub fn print(&self, language: Language) -> String {
        let printer = Printer { language };
        let items = self.items.iter().map(|item| commented(&item.comment, ["// ", ""]) + &printer.item(item));
        items.collect::<Vec<_>>().join("\n")
    }
}

struct Printer {
    language: Language,
}

impl Printer {
    fn item(&self, item: &Item) -> String {
        let name = prefixed(&item.name);
        match &item.definition {
            Definition::Constant(kind, value) => {
                let (kind, value) = (self.kind(*kind), self.expr(value));
                match self.language {
                    Language::Glsl => format!("const {kind} {name} = {value};\n"),
                    Language::Wgsl => format!("const {name}: {kind} = {value};\n"),
                    Language::Tsl => format!("const {name} = {value};\n"),
                    Language::Osl => format!("#define {name} ({value})\n"),
                }
            }
            Definition::Function { result, params, body } => self.function(&name, *result, params, body),
        }
    }

    fn function(&self, name: &str, result: Type, params: &[(Type, String)], body: &[Stmt]) -> String {
        let param = |(kind, name): &(Type, String)| match self.language {
            Language::Glsl | Language::Osl => format!("{} {name}", self.kind(*kind)),
            Language::Wgsl => format!("{name}: {}", self.kind(*kind)),
            Language::Tsl => name.clone(),
        };
        let list = params.iter().map(param).collect::<Vec<_>>().join(", ");
        let (kind, body) = (self.kind(result), self.body(body, 1));
        match self.language {
            Language::Glsl => format!("{kind} {name}({list}) {{\n{body}}}\n"),
            Language::Osl => format!("{kind} {name}(string folder, {list}) {{\n{body}}}\n"),
            Language::Wgsl => format!("fn {name}({list}) -> {kind} {{\n{body}}}\n"),
            Language::Tsl => {
                let input =
                    |(kind, name): &(Type, String)| format!("{{ name: \"{name}\", type: \"{}\" }}", kind.name());
                let inputs = params.iter().map(input).collect::<Vec<_>>().join(", ");
                format!(
                    "const {name} = Fn(([{list}]) => {{\n{body}}}).setLayout({{ name: \"{name}\", type: \"{kind}\", inputs: [{inputs}] }});\n"
                )
            }
        }
    }

    fn body(&self, body: &[Stmt], depth: usize) -> String {
        body.iter().map(|stmt| self.stmt(stmt, body, depth)).collect()
    }

    fn stmt(&self, stmt: &Stmt, around: &[Stmt], depth: usize) -> String {
        let line = |text: String| indented(depth, &text);
        let block = |body: &[Stmt]| self.body(body, depth + 1);
        let tsl = self.language == Language::Tsl;
        match stmt {
            Stmt::Let(kind, name, value) => {
                let (word, value) = (self.kind(*kind), self.expr(value));
                line(match self.language {
                    Language::Glsl | Language::Osl => format!("{word} {name} = {value};"),
                    Language::Wgsl => {
                        let changes = around.iter().any(|stmt| stmt.changes(name));
                        format!("{} {name}: {word} = {value};", if changes { "var" } else { "let" })
                    }
                    Language::Tsl => format!("const {name} = {word}({value}).toVar();"),
                })
            }
            Stmt::Set(name, value) if tsl => line(format!("{name}.assign({});", self.expr(value))),
            Stmt::Add(name, value) if tsl => line(format!("{name}.addAssign({});", self.expr(value))),
            Stmt::Set(name, value) => line(format!("{name} = {};", self.expr(value))),
            // structures have operators, but not this one
            Stmt::Add(name, value) if self.language == Language::Osl => {
                line(format!("{name} = {name} + {};", self.side(value, strength("+") + 1)))
            }
            Stmt::Add(name, value) => line(format!("{name} += {};", self.expr(value))),
            Stmt::Break => line(if tsl { "Break();" } else { "break;" }.into()),
            Stmt::Return(value) => line(format!("return {};", self.expr(value))),
            Stmt::If(condition, yes, no) => {
                let [head, middle, end] = if tsl { ["If(", ", () => {", "})"] } else { ["if (", ") {", "}"] };
                let mut text = line(format!("{head}{}{middle}", self.expr(condition))) + &block(yes);
                if !no.is_empty() {
                    let otherwise = if tsl { "}).Else(() => {" } else { "} else {" };
                    text += &(line(otherwise.into()) + &block(no));
                }
                text + &line(if tsl { format!("{end};") } else { end.into() })
            }
            Stmt::For(name, first, end, body) => {
                let (first, end) = (self.expr(first), self.expr(end));
                let [head, tail] = match self.language {
                    Language::Glsl | Language::Osl => {
                        [format!("for (int {name} = {first}; {name} < {end}; {name}++) {{"), "}".into()]
                    }
                    Language::Wgsl => {
                        [format!("for (var {name}: i32 = {first}; {name} < {end}; {name}++) {{"), "}".into()]
                    }
                    Language::Tsl => [
                        format!(
                            "Loop({{ start: {first}, end: {end}, type: \"int\", condition: \"<\", name: \"{name}\" }}, ({{ {name} }}) => {{"
                        ),
                        "});".into(),
                    ],
                };
                line(head) + &block(body) + &line(tail)
            }
        }
    }

    fn kind(&self, kind: Type) -> &'static str {
        match (self.language, kind) {
            (Language::Osl, Type::Bool) => "int",
            (Language::Osl, Type::Vec(size)) => ["vector2", "vector", "vector4"][usize::from(size) - 2],
            (Language::Wgsl, Type::Int) => "i32",
            (Language::Wgsl, Type::Float) => "f32",
            (Language::Wgsl, Type::Vec(size)) => ["vec2f", "vec3f", "vec4f"][usize::from(size) - 2],
            (Language::Wgsl, Type::IVec(size)) => ["vec2i", "vec3i", "vec4i"][usize::from(size) - 2],
            _ => kind.name(),
        }
    }

    fn expr(&self, expr: &Expr) -> String {
        match expr {
            Expr::Number(number) if self.language == Language::Tsl => {
                format!("{}({number})", if number.contains(['.', 'e']) { "float" } else { "int" })
            }
            Expr::Number(number) => number.clone(),
            // constants are ours, variables are local
            Expr::Name(name) if is_constant(name) => prefixed(name),
            Expr::Name(name) => name.clone(),
            Expr::Call(name, arguments) => {
                let two_sided = matches!(self.language, Language::Wgsl | Language::Osl);
                let ours = !BUILT_IN.iter().any(|(known, _)| known == name) && Type::named(name).is_none();
                let folder = (ours && self.language == Language::Osl).then(|| "folder".to_owned());
                let name = if name == "atan" && arguments.len() == 2 && two_sided {
                    "atan2".into()
                } else {
                    self.function_name(name)
                };
                let arguments = folder.into_iter().chain(arguments.iter().map(|argument| self.expr(argument)));
                format!("{name}({})", arguments.collect::<Vec<_>>().join(", "))
            }
            Expr::Member(of, names) if self.language == Language::Osl => format!("loden_{names}({})", self.expr(of)),
            Expr::Member(of, names) => format!("{}.{names}", self.operand(of)),
            Expr::Index(of, at) if self.language == Language::Tsl => {
                format!("{}.element({})", self.operand(of), self.expr(at))
            }
            Expr::Index(of, at) if self.language == Language::Osl => {
                format!("loden_at({}, {})", self.expr(of), self.expr(at))
            }
            Expr::Index(of, at) => format!("{}[{}]", self.operand(of), self.expr(at)),
            Expr::Unary(sign, of) if self.language == Language::Tsl => {
                format!("{}.{}()", self.expr(of), if *sign == "-" { "negate" } else { "not" })
            }
            Expr::Unary(sign, of) => format!("{sign}{}", self.operand(of)),
            Expr::Binary(sign, left, right) => self.binary(sign, left, right),
            Expr::Choose(condition, yes, no) => {
                let [condition, yes, no] = [condition, yes, no].map(|expr| self.expr(expr));
                match self.language {
                    Language::Glsl | Language::Osl => format!("({condition} ? {yes} : {no})"),
                    Language::Wgsl => format!("select({no}, {yes}, {condition})"),
                    Language::Tsl => format!("select({condition}, {yes}, {no})"),
                }
            }
        }
    }

    fn binary(&self, sign: &str, left: &Expr, right: &Expr) -> String {
        if self.language == Language::Tsl {
            let method = METHODS.iter().find(|(known, _)| *known == sign).map_or(sign, |(_, method)| method);
            return format!("{}.{method}({})", self.expr(left), self.expr(right));
        }
        format!("{} {sign} {}", self.side(left, strength(sign)), self.side(right, strength(sign) + 1))
    }

    /// A side of an operator, in parentheses if it binds less tightly than `least`.
    fn side(&self, side: &Expr, least: u8) -> String {
        match side {
            // WGSL wants parentheses around && inside ||
            Expr::Binary(inner, ..) if strength(inner) < least || strength(inner) == 2 => {
                format!("({})", self.expr(side))
            }
            _ => self.expr(side),
        }
    }

    /// What stands before a point, a bracket or after a sign.
    fn operand(&self, expr: &Expr) -> String {
        match expr {
            Expr::Binary(..) | Expr::Unary(..) if self.language != Language::Tsl => format!("({})", self.expr(expr)),
            _ => self.expr(expr),
        }
    }

    fn function_name(&self, name: &str) -> String {
        if let Some(kind) = Type::named(name) {
            return match (self.language, kind) {
                // these can be made of one number
                (Language::Osl, Type::Vec(2 | 4)) => prefixed(name),
                _ => self.kind(kind).into(),
            };
        }
        match BUILT_IN.iter().find(|(known, _)| *known == name) {
            Some((_, wgsl)) if self.language == Language::Wgsl => (*wgsl).into(),
            Some(("inversesqrt", _)) if self.language == Language::Tsl => "inverseSqrt".into(),
            Some(_) => name.into(),
            None => prefixed(name),
        }
    }
}
