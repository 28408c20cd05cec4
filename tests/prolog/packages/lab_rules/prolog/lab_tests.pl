% A file in the manner of KnowRob's packages.
:- begin_tests(lab_tools).
:- use_module(library('semweb/rdf_db')).
:- use_module(library('knowrob/knowrob')).
:- owl_parser:owl_parse('package://lab_rules/owl/test.owl').
:- rdf_db:rdf_register_prefix(test_lab, 'http://example.org/test_lab.owl#', [keep(true)]).
:- rdf_meta test_pose(r, ?).
test_pose(Obj, P) :- current_object_pose(Obj, P).
test(handle_is_there, [nondet]) :- owl_individual_of(_, knowrob:'Handle').
test(map_has_root) :- once(map_root_object(_, _)).
test(no_unicorn, [fail]) :- owl_individual_of(_, knowrob:'Unicorn').
test(assert_and_retract) :-
    rdf_instance_from_class(knowrob:'Cup', C),
    rdf_assert(C, knowrob:stateOfObject, literal(clean)),
    rdf_has(C, knowrob:stateOfObject, _),
    rdf_retractall(C, _, _).
:- end_tests(lab_tools).
