% A file in the manner of KnowRob's packages.
:- use_module(library('semweb/rdf_db'), [ rdf_meta/1 ]).
:- use_directory('model').
:- use_module('./grasping.pl').
:- use_module(lab_facts).
:- ros_package_iri(lab2, 'package://lab2/owl/lab2.owl').
:- tripledb_load('package://lab2/owl/lab2.owl', [ namespace(lab2), graph(common) ]).
:- load_owl('package://lab2/owl/lab2.owl', [ namespace(lab2, 'http://example.org/lab2.owl#') ]).
