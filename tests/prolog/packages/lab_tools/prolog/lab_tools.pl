% A file in the manner of KnowRob's packages.
:- module(lab_tools,
    [ tool_for/2, tools_of_class/2, handle_height/2, count_parts/2, heavy_thing/1, spoken_name/2 ]).
:- use_module(library('semweb/rdfs')).
:- use_module(library('semweb/rdf_db')).
:- use_module(library('semweb/owl')).
:- use_module(library('rdfs_computable')).
:- use_module(library('knowrob_objects')).
:- use_module(library('jpl')).
:- rdf_db:rdf_register_ns(rdf,     'http://www.w3.org/1999/02/22-rdf-syntax-ns#', [keep(true)]).
:- rdf_db:rdf_register_ns(owl,     'http://www.w3.org/2002/07/owl#', [keep(true)]).
:- rdf_db:rdf_register_ns(xsd,     'http://www.w3.org/2001/XMLSchema#', [keep(true)]).
:- rdf_db:rdf_register_ns(knowrob, 'http://knowrob.org/kb/knowrob.owl#', [keep(true)]).
:- rdf_meta
      tool_for(r,r),
      tools_of_class(r,-),
      handle_height(r,?),
      heavy_thing(r).
tool_for(Action, Tool) :-
    owl_subclass_of(Tool, knowrob:'Oven'),
    class_properties(Action, knowrob:deviceUsed, Tool).
tools_of_class(Class, Tools) :-
    findall(T, owl_individual_of(T, Class), Ts),
    sort(Ts, Tools).
handle_height(Obj, H) :-
    rdf_triple(knowrob:child, Obj, Handle),
    owl_individual_of(Handle, knowrob:'Handle'),
    current_object_pose(Handle, Pose),
    length(Pose, 16), nth0(11, Pose, H), !.
count_parts(Whole, N) :-
    setof(P, Whole^rdf_reachable(Whole, knowrob:properPhysicalParts, P), Ps), !,
    length(Ps, N).
count_parts(_, 0).
heavy_thing(Obj) :-
    rdf_has(Obj, knowrob:mass, literal(type(_, V))),
    atom_number(V, M), M > 5.0.
spoken_name(Obj, Name) :-
    rdf_split_url(_, Local, Obj),
    atomic_list_concat(Parts, '_', Local),
    atomic_list_concat(Parts, ' ', Name).
