//! A product quantiser: a codebook for each kind of factor, and the three indices of every texel.

use rayon::prelude::*;

use super::factors::{Kind, allowed};

/// The codewords of one kind.
pub(super) struct Codebook {
    /// (codeword, term, rgb, node)
    pub words: Vec<f32>,
    /// Numbers per codeword.
    pub size: usize,
}

/// Codewords whose error on a grid is computed exactly: the best by an upper bound.
const SHORTLIST: usize = 6;

impl Codebook {
    pub fn count(&self) -> usize {
        self.words.len() / self.size
    }

    pub fn word(&self, i: u32) -> &[f32] {
        &self.words[i as usize * self.size..][..self.size]
    }
}

/// Kinds of factors with their codebooks.
pub(super) struct Quantiser<'a> {
    pub kinds: &'a [Kind],
    pub terms: usize,
    pub books: Vec<Codebook>,
}

/// Values of a texel: (rgb, pair).
pub(super) type Texel<'a> = &'a [f32];

impl Quantiser<'_> {
    /// The table of a term and a channel within a codeword.
    fn table<'b>(&self, kind: usize, word: &'b [f32], term: usize, channel: usize) -> &'b [f32] {
        &word[(3 * term + channel) * self.kinds[kind].nodes..][..self.kinds[kind].nodes]
    }

    /// The product of all kinds but one: (term, rgb, pair).
    fn others(&self, index: &[u32], kind: usize, pairs: usize) -> Vec<f32> {
        let mut product = vec![1.0; 3 * self.terms * pairs];
        for (i, out) in product.chunks_exact_mut(pairs).enumerate() {
            for k in (0..self.kinds.len()).filter(|k| *k != kind) {
                let word = self.books[k].word(index[k]);
                self.kinds[k].multiply(self.table(k, word, i / 3, i % 3), out);
            }
        }
        product
    }

    /// The difference of a texel from its product, given the others of a kind.
    fn residual(&self, texel: Texel, kind: usize, others: &[f32], word: &[f32]) -> Vec<f32> {
        let pairs = texel.len() / 3;
        let mut residual = texel.to_vec();
        for (i, others) in others.chunks_exact(pairs).enumerate() {
            let mut part = others.to_vec();
            self.kinds[kind].multiply(self.table(kind, word, i / 3, i % 3), &mut part);
            let out = &mut residual[i % 3 * pairs..][..pairs];
            out.iter_mut().zip(&part).for_each(|(out, part)| *out -= part);
        }
        residual
    }

    fn error(&self, texel: Texel, kind: usize, others: &[f32], word: &[f32]) -> f64 {
        self.residual(texel, kind, others, word).iter().map(|e| f64::from(e * e)).sum()
    }

    /// Gives each kind in turn the codeword with which the product is closest to the texel.
    pub fn assign(&self, texel: Texel, index: &mut [u32]) {
        for kind in 0..self.kinds.len() {
            let others = self.others(index, kind, texel.len() / 3);
            let bounds = self.bounds(texel, kind, &others);
            let better = |a: &u32, b: &u32| bounds[*a as usize].total_cmp(&bounds[*b as usize]).then(a.cmp(b));
            let mut best: Vec<u32> = (0..self.books[kind].count() as u32).collect();
            if self.kinds[kind].is_sampled() {
                index[kind] = best.into_iter().min_by(better).unwrap_or(0);
                continue;
            }
            // the bound is not the error itself: compare the closest, and the one so far
            if best.len() > SHORTLIST {
                best.select_nth_unstable_by(SHORTLIST, better);
                best.truncate(SHORTLIST);
            }
            best.push(index[kind]);
            best.sort_unstable();
            let judged = best.into_iter().map(|i| (self.error(texel, kind, &others, self.books[kind].word(i)), i));
            index[kind] = judged.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, i)| i);
        }
    }

    /// The squared error of every codeword, up to a constant; on a grid an upper bound of it.
    fn bounds(&self, texel: Texel, kind: usize, others: &[f32]) -> Vec<f32> {
        let (pairs, nodes, terms) = (texel.len() / 3, self.kinds[kind].nodes, self.terms);
        let others = |term: usize, channel: usize| &others[(3 * term + channel) * pairs..][..pairs];
        // Project the texel, and the products of terms, to the nodes
        let mut right = vec![0.0; 3 * terms * nodes];
        let mut gram = vec![0.0; 3 * terms * terms * nodes];
        for channel in 0..3 {
            let texel = &texel[channel * pairs..][..pairs];
            for s in 0..terms {
                let products = others(s, channel).iter().zip(texel).map(|(g, f)| g * f);
                self.kinds[kind].add_to_nodes(products, &mut right[(3 * s + channel) * nodes..][..nodes]);
                for t in 0..terms {
                    let products = others(s, channel).iter().zip(others(t, channel)).map(|(a, b)| a * b);
                    let at = ((s * terms + t) * 3 + channel) * nodes;
                    self.kinds[kind].add_to_nodes(products, &mut gram[at..at + nodes]);
                }
            }
        }
        let bound = |word: &[f32]| {
            let linear: f32 = word.iter().zip(&right).map(|(c, a)| c * a).sum();
            let rows = 3 * nodes;
            let quadratic: f32 = (0..terms * terms)
                .map(|st| {
                    let (a, b) = (&word[st / terms * rows..][..rows], &word[st % terms * rows..][..rows]);
                    let gram = &gram[st * rows..][..rows];
                    a.iter().zip(b).zip(gram).map(|((a, b), g)| a * b * g).sum::<f32>()
                })
                .sum();
            quadratic - 2.0 * linear
        };
        self.books[kind].words.chunks_exact(self.books[kind].size).map(bound).collect()
    }

    /// Adds up what the codewords of a kind need to come closer to their texels. `rows` are the values of all texels from
    /// `first`, `members` those that use each codeword, `indices` the codewords of each texel.
    pub fn gather(
        &self,
        kind: usize,
        rows: &[f32],
        first: usize,
        members: &[Vec<u32>],
        indices: &[Vec<u32>],
        sums: &mut Sums,
    ) {
        let nodes = self.kinds[kind].nodes;
        let length = 3 * self.kinds[kind].pairs();
        let size = self.books[kind].size;
        let up = sums.up.par_chunks_exact_mut(size).zip(sums.down.par_chunks_exact_mut(size));
        up.zip(members).enumerate().for_each(|(word, ((up, down), members))| {
            for &member in members {
                let texel = &rows[(member as usize - first) * length..][..length];
                let index: Vec<u32> = indices.iter().map(|index| index[member as usize]).collect();
                let others = self.others(&index, kind, length / 3);
                let residual = self.residual(texel, kind, &others, self.books[kind].word(word as u32));
                let (mut a, mut b) = (vec![0.0f32; nodes], vec![0.0f32; nodes]);
                for (i, others) in others.chunks_exact(length / 3).enumerate() {
                    let residual = &residual[i % 3 * length / 3..][..length / 3];
                    a.fill(0.0);
                    b.fill(0.0);
                    self.kinds[kind].add_to_nodes(others.iter().zip(residual).map(|(g, e)| g * e), &mut a);
                    self.kinds[kind].add_to_nodes(others.iter().map(|g| g * g), &mut b);
                    let range = i * nodes..(i + 1) * nodes;
                    up[range.clone()].iter_mut().zip(&a).for_each(|(sum, v)| *sum += f64::from(*v));
                    down[range].iter_mut().zip(&b).for_each(|(sum, v)| *sum += f64::from(*v));
                }
            }
        });
    }

    /// Moves the codewords of a kind closer to their texels. With several terms each moves by its share, so that the
    /// error falls.
    pub fn update(&mut self, kind: usize, sums: &Sums) {
        let share = 1.0 / self.terms as f64;
        let change =
            sums.up.iter().zip(&sums.down).map(|(up, down)| if *down > 1e-30 { share * up / down } else { 0.0 });
        let terms = self.terms;
        for (value, change) in self.books[kind].words.iter_mut().zip(change) {
            *value = allowed(*value + change as f32, kind, terms);
        }
    }
}

impl Quantiser<'_> {
    /// The numbers (codeword, node, rgb) of one term of some codewords, times `scale`.
    pub fn numbers(&self, kind: usize, term: usize, used: &[u32], scale: f32) -> Vec<f32> {
        let nodes = self.kinds[kind].nodes;
        let mut numbers = Vec::with_capacity(used.len() * 3 * nodes);
        for &word in used {
            let tables = [0, 1, 2].map(|channel| self.table(kind, self.books[kind].word(word), term, channel));
            numbers.extend((0..3 * nodes).map(|i| scale * tables[i % 3][i / 3]));
        }
        numbers
    }
}

/// Sums over texels for every number of a codebook.
pub(super) struct Sums {
    up: Vec<f64>,
    down: Vec<f64>,
}

impl Sums {
    pub fn of(book: &Codebook) -> Self {
        Self { up: vec![0.0; book.words.len()], down: vec![0.0; book.words.len()] }
    }
}
