% A file in the manner of KnowRob's packages.
:- module(lab_facts, [ bench/1, drawer_of/2, sum_list_of/2, greet/0, area/3, shout/1 ]).
:- ensure_loaded(library(lists)).
:- use_module(library(aggregate)).
:- use_module(library(dcg/basics)).
:- set_prolog_flag(double_quotes, codes).
:- initialization(greet).
:- table linked/2.
bench(table). bench(counter_left).
drawer_of(D, C) :- linked(C, D).
linked(A, B) :- rdf_has(A, knowrob:child, B).
linked(A, C) :- linked(A, B), rdf_has(B, knowrob:child, C).
sum_list_of(L, S) :- sumlist(L, S).
greet :- format(atom(_), "loaded ~w~n", [lab_facts]).
area(O, A, Unit) :- object_dimensions(O, D, W, _), A is D * W, Unit = m2.
shout(T) :- concat_atom([T, '!'], '', R), writeln(user_error, R).
number_line(N) --> blanks, integer(N), blanks_to_nl.
