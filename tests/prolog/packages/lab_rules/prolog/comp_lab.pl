% A file in the manner of KnowRob's packages.
:- module(comp_lab, [ comp_reachable_by/2, comp_on_top/2, comp_dist/3 ]).
:- use_module(library('semweb/rdf_db')).
:- use_module(library('semweb/rdfs_computable')).
:- use_module(library('comp_spatial')).
:- rdf_db:rdf_register_ns(lab, 'http://example.org/lab.owl#', [keep(true)]).
:- rdf_meta comp_reachable_by(r,r), comp_on_top(r,r), comp_dist(r,r,-).
% computables as RDF
:- rdf_assert('http://example.org/lab.owl#computeOnTop', rdf:type, 'http://knowrob.org/kb/computable.owl#PrologProperty').
:- rdf_assert('http://example.org/lab.owl#computeOnTop', 'http://knowrob.org/kb/computable.owl#command', literal(type('http://www.w3.org/2001/XMLSchema#string', comp_on_top))).
:- rdf_assert('http://example.org/lab.owl#computeOnTop', 'http://knowrob.org/kb/computable.owl#target', 'http://example.org/lab.owl#onTopOf').
comp_on_top(A, B) :- on_Physical(A, B).
comp_reachable_by(A, B) :- comp_dist(A, B, D), D < 1.5.
comp_dist(A, B, D) :-
    current_object_pose(A, [_,_,_,X1,_,_,_,Y1,_,_,_,Z1,_,_,_,_]),
    current_object_pose(B, [_,_,_,X2,_,_,_,Y2,_,_,_,Z2,_,_,_,_]),
    D is sqrt((X1-X2)**2 + (Y1-Y2)**2 + (Z1-Z2)**2).
