//! Runs a surface shader at one point.

use std::collections::HashMap;
use std::f32::consts::PI;

use glam::{Mat4, Vec3};

use super::parse::{Expr, Function, Kind, Shader, Stmt};

/// A value: triples have a kind.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    Float(f32),
    Triple(Kind, Vec3),
    Matrix([f32; 16]),
    Text(String),
    /// Only conditions have it.
    Truth(bool),
}

use Value::{Float, Matrix, Text, Triple, Truth};

/// A texture of four channels.
pub struct Texture {
    pub width: usize,
    pub height: usize,
    pub numbers: Vec<f32>,
}

/// What the renderer knows of a point, in the space of the camera, which is left-handed.
pub struct Point {
    pub position: Vec3,
    pub normal: Vec3,
    pub incident: Vec3,
    pub dpdu: Vec3,
    pub dpdv: Vec3,
    /// s and t, with their derivatives along u and v.
    pub s: [f32; 3],
    pub t: [f32; 3],
    /// Directions to lights and their colours.
    pub lights: Vec<(Vec3, Vec3)>,
}

pub struct Machine<'a> {
    shader: &'a Shader,
    functions: HashMap<&'a str, &'a Function>,
    textures: &'a HashMap<String, Texture>,
    camera_from_shader: Mat4,
    /// The parameters of the shader.
    instance: Vec<(&'a str, Value)>,
    /// The number of looks into textures.
    pub looks: std::cell::Cell<usize>,
}

enum End {
    Through,
    Break,
    Return(Value),
}

struct Frame<'a> {
    names: Vec<(&'a str, Value)>,
    point: Option<&'a Point>,
    light: Option<(Vec3, Vec3)>,
    color: Vec3,
}

impl<'a> Machine<'a> {
    /// A shader with values for some of its parameters.
    pub fn new(
        shader: &'a Shader,
        textures: &'a HashMap<String, Texture>,
        camera_from_shader: Mat4,
        given: &[(&str, Value)],
    ) -> Self {
        let functions = shader.functions.iter().map(|function| (&*function.name, function)).collect();
        let mut machine = Self {
            shader,
            functions,
            textures,
            camera_from_shader,
            instance: Vec::new(),
            looks: std::cell::Cell::new(0),
        };
        let empty = Frame { names: Vec::new(), point: None, light: None, color: Vec3::ZERO };
        for (kind, name, default) in &shader.params {
            let given = given.iter().find(|(other, _)| other == name).map(|(_, value)| value.clone());
            let value = given.unwrap_or_else(|| machine.expr(default, &empty));
            machine.instance.push((name, converted(*kind, value)));
        }
        assert!(given.iter().all(|(name, _)| machine.instance.iter().any(|(known, _)| known == name)), "{given:?}");
        machine
    }

    /// The colour that the shader gives to a point.
    pub fn color(&self, point: &'a Point) -> Vec3 {
        let mut frame = Frame { names: self.instance.clone(), point: Some(point), light: None, color: Vec3::NAN };
        assert!(matches!(self.block(&self.shader.body, &mut frame), End::Through));
        frame.color
    }

    fn block(&self, body: &'a [Stmt], frame: &mut Frame<'a>) -> End {
        let before = frame.names.len();
        for stmt in body {
            match self.stmt(stmt, frame) {
                End::Through => {}
                end => {
                    frame.names.truncate(before);
                    return end;
                }
            }
        }
        frame.names.truncate(before);
        End::Through
    }

    fn stmt(&self, stmt: &'a Stmt, frame: &mut Frame<'a>) -> End {
        match stmt {
            Stmt::Declare(kind, name, value) => {
                // a variable has no value before it is given one
                let value = value.as_ref().map_or(Float(f32::NAN), |value| self.expr(value, frame));
                frame.names.push((name, converted(*kind, value)));
            }
            Stmt::Assign(name, value) => {
                let value = self.expr(value, frame);
                if let Some((_, old)) = frame.names.iter_mut().rev().find(|(other, _)| other == name) {
                    *old = converted(kind_of(old), value);
                } else if name == "Ci" {
                    let Triple(Kind::Color, color) = converted(Kind::Color, value) else { panic!("Ci is a colour") };
                    frame.color = color;
                }
            }
            Stmt::If(condition, yes, no) => {
                return self.block(if self.truth(condition, frame) { yes } else { no }, frame);
            }
            Stmt::For(first, condition, next, body) => {
                self.stmt(first, frame);
                while self.truth(condition, frame) {
                    match self.block(body, frame) {
                        End::Break => break,
                        End::Through => {}
                        end @ End::Return(_) => return end,
                    }
                    self.stmt(next, frame);
                }
            }
            Stmt::Illuminance(arguments, body) => {
                let [Triple(Kind::Point, _), Triple(_, axis), Float(angle)] =
                    [0, 1, 2].map(|k| self.expr(&arguments[k], frame))
                else {
                    panic!("illuminance of {arguments:?}")
                };
                for &(to_light, color) in &frame.point.expect("a point").lights {
                    // L is not normalised
                    let seen = to_light.normalize().dot(axis.normalize()) >= angle.cos() - 1e-6;
                    if seen {
                        frame.light = Some((3.0 * to_light, color));
                        assert!(matches!(self.block(body, frame), End::Through));
                    }
                }
                frame.light = None;
            }
            Stmt::Return(value) => return End::Return(self.expr(value, frame)),
            Stmt::Break => return End::Break,
        }
        End::Through
    }

    fn truth(&self, expr: &'a Expr, frame: &Frame<'a>) -> bool {
        match self.expr(expr, frame) {
            Truth(truth) => truth,
            other => panic!("{other:?} is no condition"),
        }
    }

    fn name(&self, name: &str, frame: &Frame) -> Value {
        if let Some((_, value)) = frame.names.iter().rev().find(|(other, _)| *other == name) {
            return value.clone();
        }
        if name == "PI" {
            return Float(PI);
        }
        let point = frame.point.expect("only shaders see the point");
        match name {
            "P" => Triple(Kind::Point, point.position),
            "N" => Triple(Kind::Normal, point.normal),
            "I" => Triple(Kind::Vector, point.incident),
            "dPdu" => Triple(Kind::Vector, point.dpdu),
            "dPdv" => Triple(Kind::Vector, point.dpdv),
            "s" => Float(point.s[0]),
            "t" => Float(point.t[0]),
            "L" => Triple(Kind::Vector, frame.light.expect("a light").0),
            "Cl" => Triple(Kind::Color, frame.light.expect("a light").1),
            "Os" => Triple(Kind::Color, Vec3::ONE),
            other => panic!("{other}"),
        }
    }

    fn expr(&self, expr: &'a Expr, frame: &Frame<'a>) -> Value {
        match expr {
            Expr::Number(number) => Float(*number),
            Expr::Text(text) => Text(text.clone()),
            Expr::Name(name) => self.name(name, frame),
            Expr::Call(name, arguments) => self.call(name, arguments, frame),
            Expr::Make(kind, space, parts) => {
                let numbers: Vec<f32> = parts.iter().map(|part| number(&self.expr(part, frame))).collect();
                if let Ok(numbers) = <[f32; 16]>::try_from(&numbers[..]) {
                    return Matrix(numbers);
                }
                let triple = Vec3::from_slice(&numbers);
                match (space.as_deref(), kind) {
                    (None, _) => Triple(*kind, triple),
                    (Some("shader"), Kind::Point) => Triple(*kind, self.camera_from_shader.transform_point3(triple)),
                    (Some("shader"), Kind::Vector) => Triple(*kind, self.camera_from_shader.transform_vector3(triple)),
                    other => panic!("{other:?}"),
                }
            }
            Expr::Cast(kind, of) => converted(*kind, self.expr(of, frame)),
            Expr::Channel(..) => panic!("only textures have channels"),
            Expr::Unary('!', of) => Truth(!self.truth(of, frame)),
            Expr::Unary(_, of) => match self.expr(of, frame) {
                Float(x) => Float(-x),
                Triple(kind, v) => Triple(kind, -v),
                other => panic!("-{other:?}"),
            },
            Expr::Binary(sign @ ("&&" | "||"), a, b) => {
                let first = self.truth(a, frame);
                Truth(if *sign == "&&" { first && self.truth(b, frame) } else { first || self.truth(b, frame) })
            }
            Expr::Binary(sign, a, b) => binary(sign, self.expr(a, frame), self.expr(b, frame)),
            Expr::Choose(parts) => self.expr(if self.truth(&parts[0], frame) { &parts[1] } else { &parts[2] }, frame),
        }
    }

    fn call(&self, name: &str, arguments: &'a [Expr], frame: &Frame<'a>) -> Value {
        if name == "texture" {
            return self.texture(arguments, frame);
        }
        if let ("Du" | "Dv", [Expr::Name(of)], Some(point)) = (name, arguments, frame.point) {
            let numbers = if of == "s" { point.s } else { point.t };
            return Float(numbers[if name == "Du" { 1 } else { 2 }]);
        }
        let values: Vec<Value> = arguments.iter().map(|argument| self.expr(argument, frame)).collect();
        let Some(function) = self.functions.get(name) else { return built_in(name, &values) };
        let names = function.params.iter().zip(values);
        let names = names.map(|((kind, name), value)| {
            assert!(
                kind_of(&value) == *kind || *kind == Kind::Vector && kind_of(&value) != Kind::Float,
                "{name} of {}",
                function.name
            );
            (&**name, converted(*kind, value))
        });
        let mut inner = Frame { names: names.collect(), point: None, light: None, color: Vec3::ZERO };
        match self.block(&function.body, &mut inner) {
            End::Return(value) => converted(function.result, value),
            _ => panic!("{name} returns nothing"),
        }
    }

    /// `texture(file[channel], s, t, "width", 0, "blur", 0)`: the pixel, whose centre must be asked for.
    fn texture(&self, arguments: &'a [Expr], frame: &Frame<'a>) -> Value {
        let [Expr::Channel(file, channel), s, t, options @ ..] = arguments else { panic!("texture of {arguments:?}") };
        let (Text(file), Float(channel)) = (self.expr(file, frame), self.expr(channel, frame)) else {
            panic!("{file:?}")
        };
        let options: Vec<Value> = options.iter().map(|option| self.expr(option, frame)).collect();
        assert_eq!(options, [Text("width".into()), Float(0.0), Text("blur".into()), Float(0.0)]);
        let texture = self.textures.get(&file).unwrap_or_else(|| panic!("there is no {file}"));
        let (x, y) =
            (number(&self.expr(s, frame)) * texture.width as f32, number(&self.expr(t, frame)) * texture.height as f32);
        assert!(texture.width.is_power_of_two() && texture.height.is_power_of_two());
        assert!((x.fract() - 0.5).abs() < 1e-3 && (y.fract() - 0.5).abs() < 1e-3, "{file}: {x} {y} is no centre");
        let pixel = y as usize * texture.width + x as usize;
        self.looks.set(self.looks.get() + 1);
        Float(texture.numbers[4 * pixel + channel as usize])
    }
}

fn kind_of(value: &Value) -> Kind {
    match value {
        Float(_) => Kind::Float,
        Triple(kind, _) => *kind,
        Matrix(_) => Kind::Matrix,
        Text(_) => Kind::Text,
        Truth(_) => panic!("a condition is no value"),
    }
}

fn number(value: &Value) -> f32 {
    match value {
        Float(x) => *x,
        other => panic!("{other:?} is no number"),
    }
}

fn converted(kind: Kind, value: Value) -> Value {
    match (kind, value) {
        (Kind::Color, Triple(Kind::Color, v)) => Triple(kind, v),
        (Kind::Color, Triple(..)) => panic!("a vector is no colour"),
        (Kind::Vector | Kind::Point | Kind::Normal, Triple(Kind::Color, _)) => panic!("a colour is no vector"),
        (Kind::Vector | Kind::Point | Kind::Normal, Triple(_, v)) => Triple(kind, v),
        (Kind::Vector | Kind::Point | Kind::Normal | Kind::Color, Float(x)) => Triple(kind, Vec3::splat(x)),
        (Kind::Matrix, Float(x)) => Matrix([x; 16]),
        (Kind::Text, Float(_)) => Text(String::new()),
        (_, value) => {
            assert_eq!(kind_of(&value), kind);
            value
        }
    }
}

fn binary(sign: &str, a: Value, b: Value) -> Value {
    match (&a, &b) {
        (Text(a), Text(b)) => return Truth(if sign == "==" { a == b } else { a != b }),
        (Float(a), Float(b)) => {
            return match sign {
                "==" => Truth(a == b),
                "!=" => Truth(a != b),
                "<" => Truth(a < b),
                ">" => Truth(a > b),
                "<=" => Truth(a <= b),
                ">=" => Truth(a >= b),
                "+" => Float(a + b),
                "-" => Float(a - b),
                "*" => Float(a * b),
                "/" => Float(a / b),
                other => panic!("{other} of numbers"),
            };
        }
        _ => {}
    }
    let kind = match (&a, &b) {
        (Triple(Kind::Point, _), Triple(Kind::Point, _)) if sign == "-" => Kind::Vector,
        (Triple(Kind::Color, _), Triple(other, _)) | (Triple(other, _), Triple(Kind::Color, _)) => {
            assert_eq!(*other, Kind::Color);
            Kind::Color
        }
        (Triple(kind, _), _) | (_, Triple(kind, _)) => *kind,
        other => panic!("{sign} of {other:?}"),
    };
    let triple = |value: &Value| match value {
        Triple(_, v) => *v,
        Float(x) => Vec3::splat(*x),
        other => panic!("{sign} of {other:?}"),
    };
    let (a, b) = (triple(&a), triple(&b));
    match sign {
        "." => Float(a.dot(b)),
        "^" => Triple(Kind::Vector, a.cross(b)),
        "+" => Triple(kind, a + b),
        "-" => Triple(kind, a - b),
        "*" => Triple(kind, a * b),
        "/" => Triple(kind, a / b),
        other => panic!("{other} of vectors"),
    }
}

fn built_in(name: &str, values: &[Value]) -> Value {
    match (name, values) {
        ("transform", [Text(to), Triple(kind, v)]) if to == "camera" => Triple(*kind, *v),
        ("vtransform", [Text(to), Triple(_, v)]) if to == "camera" => Triple(Kind::Vector, *v),
        ("vtransform", [Text(from), Text(to), Triple(_, v)]) if from == "camera" && to == "current" => {
            Triple(Kind::Vector, *v)
        }
        ("xcomp" | "ycomp" | "zcomp", [Triple(kind, v)]) => {
            assert_ne!(*kind, Kind::Color);
            Float(v[["xcomp", "ycomp", "zcomp"].iter().position(|other| *other == name).unwrap()])
        }
        ("comp", [Matrix(m), Float(row), Float(column)]) => Float(m[4 * *row as usize + *column as usize]),
        ("concat", parts) => {
            Text(parts.iter().map(|part| if let Text(text) = part { &**text } else { panic!("{part:?}") }).collect())
        }
        ("length", [Triple(_, v)]) => Float(v.length()),
        ("normalize", [Triple(kind, v)]) => Triple(*kind, *v / v.length()),
        ("faceforward", [Triple(kind, n), Triple(_, i)]) => Triple(*kind, if n.dot(*i) > 0.0 { -*n } else { *n }),
        _ => Float(of_numbers(name, &values.iter().map(number).collect::<Vec<_>>())),
    }
}

fn of_numbers(name: &str, numbers: &[f32]) -> f32 {
    match (name, numbers) {
        ("abs", [x]) => x.abs(),
        ("acos", [x]) => x.acos(),
        ("atan", [x]) => x.atan(),
        ("atan", [y, x]) => y.atan2(*x),
        ("ceil", [x]) => x.ceil(),
        ("clamp", [x, low, high]) => x.max(*low).min(*high),
        ("cos", [x]) => x.cos(),
        ("degrees", [x]) => x.to_degrees(),
        ("exp", [x]) => x.exp(),
        ("floor", [x]) => x.floor(),
        ("inversesqrt", [x]) => 1.0 / x.sqrt(),
        ("log", [x]) => x.ln(),
        ("max", [a, b]) => a.max(*b),
        ("min", [a, b]) => a.min(*b),
        ("mod", [a, b]) => a - b * (a / b).floor(),
        ("pow", [a, b]) => a.powf(*b),
        ("radians", [x]) => x.to_radians(),
        ("round", [x]) => (x + 0.5).floor(),
        ("sin", [x]) => x.sin(),
        ("sqrt", [x]) => x.sqrt(),
        ("tan", [x]) => x.tan(),
        other => panic!("{other:?}"),
    }
}
